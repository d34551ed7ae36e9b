"""How far a survey is from the truth: its conductors, what it says of their uncertainty, its clearances."""
