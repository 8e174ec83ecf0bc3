"""The link that docs/how-to/connect-a-rig.md shows, as the page shows it: what it delivers is the loop, bit for bit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError, TargetError
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.rig.link import ExcitationPhase, TargetLink, TargetSettings, TargetState, TooLateError
from amb_sim_node.bridge_parameters import LinkParameters
from amb_sim_node.rig_link import link_of
from tests.unit.test_target_link import Listener, settled

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "connect-a-rig.md"
NOISE = np.random.default_rng(1).normal(0.0, 2e-6, (200, 2))


def write_example(folder: Path) -> None:
    """The module of the page, installed as its package would be."""
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    (example,) = [block for block in blocks if "class VendorLink" in block]
    (folder / "vendor_link.py").write_text(example)
    offers = re.findall(r'^\[project.entry-points."amb.links"\]\n(vendor) = "(.*)"$', PAGE.read_text(), re.MULTILINE)
    ((kind, place),) = offers
    offer_link(folder, kind, place)


def offer_link(folder: Path, kind: str, place: str) -> None:
    """Offer a class in a folder as link of a kind, as the package that it would be in."""
    name = place.partition(":")[0]
    installed = folder / f"{name}-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text(f"[amb.links]\n{kind} = {place}\n")


@pytest.fixture
def link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_example(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    link = link_of(LinkParameters(kind="vendor"), lambda: None)
    yield link
    link.close()


@pytest.mark.parametrize("kind", ["sys:exit", "vendor_link:VendorLink", "os.path", ""])
def test_only_an_installed_link_is_loaded(link: TargetLink, kind: str) -> None:
    with pytest.raises(ParameterError, match=r"not allowed; allowed: amb_udp, vendor; a package .* group amb\.links"):
        link_of(LinkParameters(kind=kind), lambda: None)


def test_the_example_of_a_link_delivers_the_loop_bit_for_bit(link: TargetLink) -> None:
    listener, law = Listener(), ControllerParameters(nominal_reference=(0.0, 10e-6))
    description = link.connect(listener)
    link.configure(TargetSettings(law, description.limits, ()))
    link.levitate(0.0)
    arm = link.upload(NOISE)
    with pytest.raises(TooLateError):
        arm(0)
    start = settled(link, TargetState.LEVITATED).step + 2_000
    arm(start)
    listener.wait_for_step(start + 500)
    link.land(0.01)
    settled(link, TargetState.OFF)
    words = np.concatenate([block.status for block in listener.blocks if block.status is not None])
    first = int(np.argmax((words & 7) != TargetState.OFF))
    expected = simulate(Plant(PlantParameters()), PdController(law), start + 500 - first, NOISE, start - first)
    for name in ("reference", "position", "current"):
        assert listener.at(first, expected.steps, name).tobytes() == getattr(expected, name).tobytes(), name
    playing = np.flatnonzero((words >> 4) & 3 == ExcitationPhase.PLAYING)
    assert (playing[0], len(playing)) == (start, len(NOISE))


def test_the_example_of_a_link_refuses_a_levitation_while_a_trip_is_latched(link: TargetLink) -> None:
    listener = Listener()
    description = link.connect(listener)
    law = ControllerParameters(proportional_gain=100.0)  # too soft for the magnets
    link.configure(TargetSettings(law, description.limits, ()))
    link.levitate(0.0)
    settled(link, TargetState.TRIPPED)
    with pytest.raises(TargetError, match="latched"):
        link.levitate(0.0)
    link.reset_faults()
    assert settled(link, TargetState.OFF).trips == ()
