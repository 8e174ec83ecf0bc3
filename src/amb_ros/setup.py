"""Build of the package amb_ros."""

from setuptools import find_packages, setup

NAME = "amb_ros"

setup(
    name=NAME,
    version="0.2.0",
    description="ROS wiring shared by the nodes: parameters, process life cycle, quality of service, diagnostics.",
    maintainer="AMB workbench maintainers",
    maintainer_email="maintainers@users.noreply.example",
    url="https://users.noreply.example/amb-workbench",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "*.xml", "*.c"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["numpy>=1.26,<3", "psutil>=6", "rosbags>=0.11.9,<0.12", "threadpoolctl>=3.1,<4"],
    extras_require={"test": ["hypothesis", "pytest", "pytest-timeout"]},
    zip_safe=False,
)
