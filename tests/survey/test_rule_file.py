"""Matrices of clearances are read whole, the package's among them; what is wrong is named before a survey."""

from importlib.resources import files
from pathlib import Path

import pytest

from plnerf.errors import ConfigError
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.rule_file import load_matrix

OWN = sorted(one.name for one in (files("plnerf") / "data" / "rules").iterdir())
HEAD = "name = 'a'\nsource = 'b'\ndate = 'c'\n"
ROW = "[[row]]\nobject = 'ground'\ndirection = 'vertical'\ndistance = 7.0\nread_in = 'here'\n"


def put(tmp: Path, text: str) -> Path:
    path = tmp / "rules.toml"
    path.write_text(text, encoding="utf-8")
    return path


def required(name: str, kv: float) -> dict[tuple[str, str], list[float]]:
    matrix, found = load_matrix(Path(name)), {}  # type: ignore[var-annotated]
    for one in matrix.rows:
        rule = matrix.rule(one, kv)
        if rule is not None:
            found.setdefault((rule.object, rule.direction), []).append(round(rule.required_m, 3))
    return found


@pytest.mark.parametrize("name", OWN)
def test_the_packages_matrices_say_where_each_number_was_read_and_claim_no_comparison(name: str) -> None:
    matrix = load_matrix(Path(name))
    kv = matrix.classes_kv[0] if matrix.classes_kv else 115.0
    rules = [matrix.rule(one, kv) for one in matrix.rows]
    assert any(rules) and all(one is None or (one.read_in and not one.verified) for one in rules)
    assert "example" in matrix.name and any("compared" in text for text in matrix.caveats)


def test_numbers_of_the_examples() -> None:
    """By hand: 18.5 ft and 0.4 in for each kV that 115 * 1.05 / sqrt 3 is above 22; 5 m and D_el of 1.7 m."""
    above = (115 * 1.05 / 3**0.5 - 22) * 0.4 * 0.0254
    nesc = required("nesc-232", 115.0)["ground", "vertical"]
    assert nesc == [pytest.approx(18.5 * 0.3048 + above, abs=2e-3)]
    assert required("nesc-232", 12.5)["road", "vertical"] == [pytest.approx(5.639, abs=1e-3)]
    uk = required("en-50341-uk", 132.0)
    assert uk["ground", "vertical"] == [6.2, 6.7] and uk["road", "vertical"] == [7.2]
    by_regulation = [required("en-50341-uk", kv)["ground", "vertical"][1] for kv in (110.0, 220.0, 400.0)]
    assert by_regulation == [6.7, 7.0, 7.3]  # above 66, 132 and 275 kV
    assert required("gb-50545", 500.0)["ground", "vertical"] == [14.0, 11.0]
    assert required("fac-003-5", 345.0) == {("vegetation", "radial"): [pytest.approx(4.3 * 0.3048, abs=1e-3)]}


def test_a_term_of_one_number_counts_at_any_voltage(tmp_path: Path) -> None:
    """Where a matrix has no classes, too."""
    path = put(tmp_path, HEAD + ROW + "plus = ['x']\n[term.x]\ndistance = 1.5\nread_in = 'a'\n")
    assert required(str(path), 115.0) == {("ground", "vertical"): [8.5]}


def test_how_a_distance_came_about_is_said() -> None:
    matrix = load_matrix(Path("en-50341-uk"))
    rule = matrix.rule(matrix.rows[0], 400.0)
    assert rule is not None and rule.made_of == "5.00 m + 2.80 m (D_el)"
    assert rule.read_in.startswith("elektro-energetika.cz") and "from memory (EN 50341-1, table of D_el" in (
        rule.read_in
    )
    assert rule.states == ("still", "ice")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD, "needs row, tables \\[\\[row\\]\\]: it is missing"),
        (ROW, "needs name, a text: it is missing"),
        (HEAD + ROW.replace("ground", "sky"), "Row 1 of .* needs object, one of ground, road.*: got 'sky'"),
        (HEAD + ROW.replace("vertical", "down"), "needs direction, one of vertical, radial: got 'down'"),
        (HEAD + ROW.replace("ground", "line").replace("vertical", "horizontal"), "needs direction, one of v"),
        (HEAD + ROW.replace("ground", "road").replace("vertical", "radial"), "one of vertical, horizontal"),
        (HEAD + ROW + "states = ['hot']\n", "is for the states hot, but knows only still, wind, ice"),
        (HEAD + ROW.replace("7.0", "[7.0, 8.0]"), "has 2 distances for 0 classes"),
        (HEAD + ROW.replace("7.0", "-7.0"), "distances that are not greater than 0"),
        (HEAD + ROW.replace("7.0", "'seven'"), "needs distance, a number, or several in brackets"),
        (HEAD + ROW + "plus = ['D_el']\n", "adds D_el, but the file has no \\[term.D_el\\]"),
        (HEAD + ROW.replace("read_in = 'here'\n", ""), "needs read_in, a text: it is missing"),
        (HEAD + "colour = 3\n" + ROW, "has colour, which is not known there"),
        (HEAD + "kv_between = [100, 5]\n" + ROW, "voltages that are greater than 0, in rising order"),
        (HEAD + ROW + "[term.x]\nread_in = 'a'\n", "\\[term.x\\] of .* needs per_kv"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_matrix_is_named(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        RulesConfig(put(tmp_path, text), 110.0)


def test_voltages_are_never_interpolated(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gb-50545 has no class of 132 kV. Its classes are 110, 220, 330"):
        RulesConfig(Path("gb-50545"), 132.0)
    with pytest.raises(ConfigError, match=r"nesc-232 is for 1 to 500 kV \(nominal\), got 765 kV"):
        RulesConfig(Path("nesc-232"), 765.0)
    with pytest.raises(ConfigError, match=r"by voltage, but none is given. Give --voltage-kv"):
        RulesConfig(Path("gb-50545"))
    with pytest.raises(ConfigError, match=r"no rules are given. Give --rules"):
        RulesConfig(objects=(Path("a.gpkg"),))
    with pytest.raises(ConfigError, match=r"no rule file gb.toml.*en-50341-uk, fac-003-5, gb-50545"):
        RulesConfig(Path("gb.toml"), 110.0)
