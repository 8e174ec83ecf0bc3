"""Build of the package amb_ros."""

from setuptools import find_packages, setup

NAME = "amb_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="ROS wiring shared by the nodes: parameters, process life cycle, quality of service, diagnostics.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "*.xml", "*.c"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
)
