"""Build of the package amb_sim_node."""

from setuptools import find_packages, setup

NAME = "amb_sim_node"

setup(
    name=NAME,
    version="0.2.0",
    description="Simulator of active magnetic bearings as a ROS 2 node, and an emulator of their real-time target.",
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
    install_requires=["numpy>=1.26,<3", "pydantic>=2.5,<3"],
    extras_require={"test": ["hypothesis", "pytest", "pytest-timeout"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "hardware_bridge=amb_sim_node.executables:hardware_bridge",
            "simulator=amb_sim_node.executables:simulator",
            "target_emulator=amb_sim_node.executables:target_emulator",
        ]
    },
)
