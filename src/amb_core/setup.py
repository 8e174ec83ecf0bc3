"""Build of the package amb_core."""

from glob import glob

from setuptools import find_packages, setup

NAME = "amb_core"

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
            *("report/*.j2", "report/page.css", "report/page.js"),
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/target", sorted(glob("../../target/*.[ch]"))),  # for the target emulator
        (f"share/{NAME}/target/hosted", sorted(glob("../../target/hosted/*.[ch]"))),
    ],
    install_requires=["setuptools"],
    extras_require={"ross": ["ross-rotordynamics>=2.3,<3", "plotly<7"]},  # pinned in requirements-ross.txt
    zip_safe=False,
)
