"""Settings of detection: the defaults stand, wrong ones are named, and all of them come back from JSON."""

import math
from dataclasses import fields, replace
from typing import Any

import pytest

from plnerf.detect.config import (
    CertaintyConfig,
    DetectConfig,
    JoinConfig,
    MeetConfig,
    OddsConfig,
    RefitConfig,
    SearchConfig,
    SelectConfig,
)
from plnerf.detect.config_lines import (
    ChainConfig,
    DirectionConfig,
    EvidenceConfig,
    LineMapConfig,
    RidgeConfig,
    SegmentConfig,
)
from plnerf.detect.config_windows import OnwardConfig, WindowConfig
from plnerf.errors import ConfigError
from plnerf.train.settings import from_json, to_json


@pytest.mark.parametrize(
    ("part", "wrong"),
    [
        (EvidenceConfig, {"scales_px": ()}),
        (EvidenceConfig, {"scales_px": (1.0, 0.0)}),
        (EvidenceConfig, {"contrast_px": 0.0}),
        (EvidenceConfig, {"sag_deg": -1.0}),
        (EvidenceConfig, {"apart_deg": 0.0}),
        (EvidenceConfig, {"beside_px": 6}),
        (OddsConfig, {"shown": 1.0}),
        (OddsConfig, {"min_density": 0.0}),
        (OddsConfig, {"min_response": 0.0}),
        (OddsConfig, {"radii_px": (3.0, 1.0)}),
        (OddsConfig, {"radii_px": (3.0, 33.0)}),
        (OddsConfig, {"sharp_px": 0.0}),
        (OddsConfig, {"muffled_px": -1}),
        (RefitConfig, {"windows_px": ()}),
        (RefitConfig, {"windows_px": (4, 0)}),
        (RefitConfig, {"prior": 0.0}),
        (SearchConfig, {"sides_deg": 0.0}),
        (SearchConfig, {"coarse": 0}),
        (SearchConfig, {"fruitless": 0}),
        (SearchConfig, {"reach": 0.0}),
        (ChainConfig, {"most": 0}),
        (ChainConfig, {"spare": -0.1}),
        (ChainConfig, {"least_angle": 1.0}),
        (SearchConfig, {"max_lines": 0}),
        (SearchConfig, {"sharpness_px": ()}),
        (SearchConfig, {"mask_rms": 0.0}),
        (SearchConfig, {"refits": -1}),
        (SelectConfig, {"max_sag_ratio": 0.9}),
        (SelectConfig, {"min_sag": -0.1}),
        (CertaintyConfig, {"certain_px": 0.0}),
        (CertaintyConfig, {"nearest_views": 0.0}),
        (RidgeConfig, {"directions": 30}),
        (RidgeConfig, {"scales_px": ()}),
        (RidgeConfig, {"half_length_px": 0.0}),
        (RidgeConfig, {"edge_weight": -1.0}),
        (LineMapConfig, {"min_response": 0.0}),
        (LineMapConfig, {"beside_px": 6}),
        (DirectionConfig, {"step_rad": 0.0}),
        (DirectionConfig, {"max_slope_rad": 1.6}),
        (DirectionConfig, {"azimuth_deg": math.inf}),
        (DirectionConfig, {"most": 0}),
        (DirectionConfig, {"partners": 0}),
        (DirectionConfig, {"least_angle": 0.6}),
        (DirectionConfig, {"least_overlap": 1.0}),
        (DirectionConfig, {"few_px": 0.0}),
        (DirectionConfig, {"around_rad": 0.01}),
        (DirectionConfig, {"least_near": 1.5}),
        (SegmentConfig, {"least_px": 0.0}),
        (SegmentConfig, {"turn_rad": 1.6}),
        (SegmentConfig, {"min_response": 1.5}),
        (WindowConfig, {"planes": 5}),
        (WindowConfig, {"spacings": 0.0}),
        (WindowConfig, {"spacings": 41.0}),
        (OddsConfig, {"coarsest": 1.5}),
        (OddsConfig, {"enough_px": 0.0}),
        (EvidenceConfig, {"most_px": 8}),
        (SearchConfig, {"stretches": 0}),
        (JoinConfig, {"min_overlap": 0.0}),
        (MeetConfig, {"about": 0.5}),
        (MeetConfig, {"sigmas": 0.0}),
        (OnwardConfig, {"half_px": 0.0}),
        (OnwardConfig, {"step_rad": 1.0}),
        (OnwardConfig, {"most": 0}),
    ],
)
def test_a_wrong_value_is_refused_and_shown(part: type, wrong: dict[str, Any]) -> None:
    ((name, value),) = wrong.items()
    with pytest.raises(ConfigError, match=r"^detect\.\w+ needs .*, but got") as caught:
        part(**wrong)
    assert f"{name}={value!r}" in str(caught.value)


def test_every_part_has_a_name_in_the_error_texts() -> None:
    parts = {field.name for field in fields(DetectConfig)}
    assert parts == {
        "evidence", "odds", "chains", "refit", "search", "select", "certainty", "ridges",
        "lines", "directions", "windows", "join", "meet", "surroundings",
        "segments", "onward",
    }  # fmt: skip


def test_settings_come_back_from_json() -> None:
    config = replace(
        DetectConfig(), chains=ChainConfig(least_px=100 / 3), odds=OddsConfig(radii_px=(1.0, 2.0))
    )
    assert from_json(DetectConfig, to_json(config), "here") == config
