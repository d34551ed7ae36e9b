"""Texts that others wrote, such as names of files, as the page's markdown shows them: as they are."""


def plain(text: str) -> str:
    """The text with every character that markdown or HTML could obey written as its number."""
    return "".join(one if one.isalnum() or one in " ,." else f"&#{ord(one)};" for one in text)
