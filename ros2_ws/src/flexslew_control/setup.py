from setuptools import find_packages, setup

CONTROLLERS = (
    "pd_feedforward",
    "output_feedback",
    "proportional_integral",
    "lqr",
    "collocated_pid",
)

setup(
    name="flexslew_control",
    version="0.1.0",
    packages=find_packages(),
    package_data={"flexslew_control": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/flexslew_control"]),
        ("share/flexslew_control", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "planner = flexslew_control.ros.planner_node:main",
            "controller = flexslew_control.ros.controller_node:main",
            *(f"{name} = flexslew_control.ros.controller_node:main" for name in CONTROLLERS),
        ]
    },
)
