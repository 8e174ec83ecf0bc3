"""Build of the package amb_paper."""

from setuptools import find_packages, setup

NAME = "amb_paper"

setup(
    name=NAME,
    version="0.2.0",
    description="The studies of the paper: its figures and claims on the simulator, as a report.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    url="https://users.noreply.example/amb-workbench",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["numpy>=1.26,<3", "rich>=13.7", "scipy>=1.11,<2", "typer>=0.12.4"],
    extras_require={"test": ["hypothesis", "pytest", "pytest-timeout"]},
    zip_safe=False,
)
