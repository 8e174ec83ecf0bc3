"""Build of the package amb_core."""

from glob import glob

from setuptools import find_packages, setup

NAME = "amb_core"
REQUIRED = [  # versions that these allow; those that are tested are pinned in requirements.txt
    "Jinja2>=3,<4",
    "MarkupSafe>=3,<4",
    "PyYAML>=6,<7",
    "control>=0.10,<0.11",
    "ctrlsys>=1.1,<2",
    "dask>=2026.8",
    "distributed>=2026.8",
    "h5py>=3.16,<4",
    "lz4>=4",
    "matplotlib>=3.11,<4",
    "mcap>=1.6,<2",
    "numba>=0.68",
    "numpy>=2.4,<3",
    "plotly>=6.9,<7",
    "pyarrow>=26",
    "pydantic>=2.14,<3",
    "rosbags>=0.11,<0.12",
    "scipy>=1.17,<2",
    "threadpoolctl>=3.6,<4",
    "zstandard>=0.25",
]

setup(
    name=NAME,
    version="0.1.0",
    description="Active magnetic bearings without ROS: plant, control law, excitations, identification and bags.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            "py.typed",
            *("figures/*.j2", "figures/page.css", "figures/draw.js"),
            "export/templates/*.j2",
            *("report/*.j2", "report/page.css", "report/page.js"),
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/target", sorted(glob("../../target/*.[ch]"))),  # for the target emulator
        (f"share/{NAME}/target/hosted", sorted(glob("../../target/hosted/*.[ch]"))),
    ],
    install_requires=REQUIRED,
    extras_require={"ross": ["ross-rotordynamics>=2.3,<3", "plotly<7"]},  # pinned in requirements-ross.txt
    zip_safe=False,
)
