"""Build of the package amb_controller_node."""

from setuptools import find_packages, setup

NAME = "amb_controller_node"

setup(
    name=NAME,
    version="0.2.0",
    description="Position controllers and excitation generator of an active magnetic bearing as ROS 2 nodes.",
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
    install_requires=["numpy>=1.26,<3"],
    extras_require={"test": ["hypothesis", "pytest", "pytest-timeout"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "pd_controller=amb_controller_node.executables:pd_controller",
            "state_space_controller=amb_controller_node.executables:state_space_controller",
            "excitation_generator=amb_controller_node.executables:excitation_generator",
        ]
    },
)
