"""`plnerf corridor`: what it prints, its exit status, and the table of blocks."""

from pathlib import Path

import pytest
from rich.console import Console
from tests.support.corridors import KnownLine, photos_along
from tests.support.many_spans import FEET, PHASES, line_along

from plnerf.cli.corridor import corridor, stages
from plnerf.corridor import engine
from plnerf.corridor.ledger import Ledger, Task
from plnerf.errors import SurveyError

LINE = line_along(FEET[:3], PHASES)


class Failing(KnownLine):
    """Fails on the second span."""

    def __call__(self, out: Path, task: Task) -> None:
        if task.folder == "spans/0002":
            raise SurveyError("a photo is damaged")
        super().__call__(out, task)


@pytest.mark.slow
def test_it_prints_how_far_it_is_and_where_results_lie(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = photos_along(tmp_path / "scene", LINE), tmp_path / "out"
    one = engine.InThisProcess
    monkeypatch.setattr(engine, "InThisProcess", lambda: one(Failing(LINE)))
    with pytest.raises(SystemExit) as ended:
        corridor(scene, out=out, block_m=70.0, overlap_m=30.0)
    assert ended.value.code == 1
    lines = capsys.readouterr().out.splitlines()
    assert "wires: 3 blocks" in lines and "survey: 2 blocks" in lines
    assert any(one.startswith("survey of spans/0001: done in 1 s; 1 of 2") for one in lines)
    assert "survey of spans/0002: failed a photo is damaged" in lines
    assert "spans-0002-survey could not be done: a photo is damaged" in lines
    assert f"4 wires in 1 spans, 2 structures: {out}" in lines
    assert lines[-1] == f"report: {out / 'index.html'}"
    monkeypatch.setattr(engine, "InThisProcess", lambda: one(KnownLine(LINE)))
    corridor(scene, out=out, block_m=70.0, overlap_m=30.0)
    lines = capsys.readouterr().out.splitlines()
    assert "wires: 3 blocks, 3 of them done before" in lines
    assert f"8 wires in 2 spans, 3 structures: {out}" in lines


def test_a_terminal_shows_a_table_of_all_blocks(tmp_path: Path) -> None:
    console = Console(force_terminal=True, width=80, height=12, record=True)
    ledger, tasks = Ledger(tmp_path), [Task("find", f"find/{k:04d}", {"k": k}) for k in range(30)]
    with stages(console) as heard:
        heard("wires", tasks, ledger)
        for task in tasks[:20]:
            ledger.write(task, "done", seconds=1.0)
        ledger.write(tasks[20], "running")
        ledger.write(tasks[21], "failed", error="a photo is damaged")
        heard("wires", tasks, ledger)
    shown = console.export_text()
    assert "20 of 30" in shown and "left" in shown
    assert "find/0020" in shown and "..." in shown
