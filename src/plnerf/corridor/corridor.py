"""A whole corridor, block after block: of images or of clouds; one line and one report out.

    OUT/find/, OUT/spans/, OUT/clouds/   blocks: `image_corridor.py`, `cloud_corridor.py`
    OUT/ledger/                          a record for each task
    OUT/        survey.json (the joined line), index.html, corridor.json, corridor.gpkg, clouds.json

Nothing is printed: tasks are announced by a callback.
"""

from dataclasses import replace
from pathlib import Path

from plnerf.corridor.cloud_blocks import is_cloud
from plnerf.corridor.cloud_corridor import survey_clouds
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.engine import Engine, InThisProcess
from plnerf.corridor.image_corridor import survey_images
from plnerf.corridor.merge import merged, read_blocks
from plnerf.corridor.results import Corridor, write_results
from plnerf.corridor.stages import Heard, Stages
from plnerf.corridor.tasks import SURVEY
from plnerf.errors import SurveyError
from plnerf.scene.only_writer import only_writer
from plnerf.survey.config_names import NamesConfig
from plnerf.survey.like_strings import with_like_strings
from plnerf.survey.names import with_names
from plnerf.train.settings import to_json


def survey_corridor(
    source: Path,
    out: Path,
    config: CorridorConfig | None = None,
    engine: Engine | None = None,
    heard: Heard | None = None,
) -> Corridor:
    """Surveys a scene, or a folder of LAS and LAZ tiles, of any size into a folder; what is up to date is
    not done again.

    config: None: the default for images or for clouds.  A block that fails keeps no other from being done,
    and is named in the result.  Raises ConfigError where the scene has no scale, SurveyError where no block
    could be surveyed, and the errors of reading a scene or clouds.
    """
    cloud = is_cloud(source)
    config = config or (CorridorConfig.of_clouds() if cloud else CorridorConfig())
    stages = Stages(out, engine or InThisProcess(), heard or (lambda stage, tasks, ledger: None))
    with only_writer(out):
        unnamed = replace(config, survey=replace(config.survey, names=NamesConfig()))
        found = (survey_clouds if cloud else survey_images)(source, unnamed, stages)
        ledger = stages.ledger
        records = [(task, ledger.record(task)) for task in found.tasks]
        failed = tuple((task.name, one.error) for task, one in records if one.state != "done")
        folders = {
            out / task.folder / SURVEY: numbers for task, numbers in found.surveys if ledger.done(task)
        }
        if not folders and failed:
            raise SurveyError(f"No block of {source} could be surveyed. {failed[0][0]}: {failed[0][1]}")
        blocks = read_blocks(folders)
        survey = merged(blocks, found.planned, found.frame, str(source), {"input": found.about})
        survey = replace(
            survey,
            lines=with_like_strings(survey.lines, config.survey.strings),
            findings=(*survey.findings, *found.findings),
        )
        # Names are matched over the whole line: a phase that is named in one span goes through all of them,
        # and another list of names changes no block.
        survey = with_names(survey, config.survey.names, config.survey.kinds)
        return write_results(out, survey, blocks, records, to_json(config), failed)
