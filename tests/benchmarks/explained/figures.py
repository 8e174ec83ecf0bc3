"""What `make bench-explained` writes to results/bench_explained.json."""

from __future__ import annotations

from tests.benchmarks.explained.distortion import Distortion
from tests.benchmarks.explained.excitation import Excitation
from tests.benchmarks.explained.identification import Identification
from tests.benchmarks.explained.map_lines import MapLines
from tests.benchmarks.explained.map_rates import MapRates
from tests.benchmarks.explained.plant import Plant
from tests.benchmarks.explained.region_maps import RegionMaps
from tests.benchmarks.explained.subharmonics import Subharmonics
from tests.front_door.figures import Figures


class BenchExplained(Figures):
    """All of it, by page."""

    distortion: Distortion
    excitation: Excitation
    identification: Identification
    map_lines: MapLines
    map_rates: MapRates
    plant: Plant
    region_maps: RegionMaps
    subharmonics: Subharmonics
