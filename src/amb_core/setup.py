"""Build of the package amb_core."""

from glob import glob

from setuptools import find_packages, setup

NAME = "amb_core"
REQUIRED = [  # lower bounds are tested by `make floor`, the versions in requirements.txt by all other targets
    "PyYAML>=6,<7",
    "ctrlsys>=1.1,<2",
    "lz4>=4.4",
    "mcap>=1.5,<2",
    "numba>=0.59",
    "numpy>=1.26,<3",
    "pydantic>=2.5,<3",
    "rosbags>=0.11.9,<0.12",
    "scipy>=1.11,<2",
    "threadpoolctl>=3.1,<4",
    "zstandard>=0.22",
]
EXTRAS = {
    "cluster": ["cryptography>=41", "dask>=2024.5", "distributed>=2024.5", "psutil>=6"],
    "control": ["control>=0.10.1,<0.11"],
    "figures": ["Jinja2>=3.1,<4", "MarkupSafe>=2.1,<4", "matplotlib>=3.6,<4", "plotly>=6,<7"],
    "files": ["Jinja2>=3.1,<4", "h5py>=3.10,<4", "pyarrow>=14"],
}
TARGET = [f"rig/link/c/{files}" for files in ("*.[ch]", "hosted/*.[ch]")]  # the C code, for the target emulator
if not all(glob(f"{NAME}/{files}") for files in TARGET):
    raise SystemExit(f"{NAME}/rig/link/c, which links to the folder target of the checkout, has no C code")

setup(
    name=NAME,
    version="0.2.0",
    description="Active magnetic bearings without ROS: plant, control law, excitations, identification and bags.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    url="https://users.noreply.example/amb-workbench",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            "py.typed",
            *("report/figures/*.j2", "report/figures/page.css", "report/figures/draw.js"),
            "recording/export/templates/*.j2",
            *("report/pages/*.j2", "report/pages/page.css", "report/pages/page.js"),
            *TARGET,
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=REQUIRED,
    extras_require={
        **EXTRAS,
        "all": sorted({requirement for part in EXTRAS.values() for requirement in part}),
        "test": ["hypothesis", "pytest", "pytest-timeout"],
        "ross": ["ross-rotordynamics>=2.3,<3", "plotly<7"],  # pinned in requirements-ross.txt
    },
    zip_safe=False,
)
