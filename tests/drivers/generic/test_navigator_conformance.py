"""The navigator's two drivers pass the tests that a laboratory runs on a driver of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from conformance_runs import conformance
from navigator_fixture import KINDS, bench_of

FOG = "fog-scale-factor-temperature"


@pytest.mark.parametrize("kind", KINDS)
def test_our_navigator_conforms_in_its_own_world(kind: str, tmp_path: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(bench_of(kind)), encoding="utf-8")
    done = conformance(tmp_path, f"{kind}-navigator", str(bench), "--station-procedure", FOG)
    assert done.returncode == 0, done.stdout
    assert "test_sampled_source" in done.stdout
