"""Build of the package amb_bringup."""

from glob import glob

from setuptools import find_packages, setup

NAME = "amb_bringup"

setup(
    name=NAME,
    version="0.2.0",
    description="Launch files, parameter files and the command line of the active magnetic bearing workbench.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    url="https://users.noreply.example/amb-workbench",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "view/page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.yaml"))),
        (f"share/{NAME}/layouts", sorted(glob("layouts/*.xml") + glob("layouts/*.json"))),  # of PlotJuggler, Foxglove
        (f"share/{NAME}/config", sorted(glob("config/*.yaml") + glob("config/*.npz"))),
        ("bin", ["bin/amb"]),  # colcon puts bin/ on PATH, so `amb` works wherever the workspace is sourced
    ],
    install_requires=["PyYAML>=6,<7", "numpy>=1.26,<3", "rich>=13.7", "typer>=0.12.4"],
    extras_require={
        "foxglove": ["foxglove-sdk>=0.30,<0.31"],  # pinned in requirements-foxglove.txt
        "test": ["hypothesis", "pytest", "pytest-timeout"],
        "view": ["tornado>=6.4"],
    },
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "amb=amb_bringup.command_line:main",
            "composed_loop=amb_bringup.executables:composed_loop",
        ]
    },
)
