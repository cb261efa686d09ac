from glob import glob

from setuptools import find_packages, setup

setup(
    name="flexslew_lab",
    version="0.1.0",
    packages=find_packages(),
    package_data={
        "flexslew": ["py.typed"],
        "flexslew_lab": [
            "py.typed",
            "benchmark/*.json",
            "benchmark/*.yaml",
            "benchmark/tasks/*.yaml",
            "export/fmu/c/*",
            "report/*.j2",
            "studies/*.j2",
            "studies/shipped/*.yaml",
            "tuning/shipped/*.yaml",
            "trials/*.yaml",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/flexslew_lab"]),
        ("share/flexslew_lab", ["package.xml"]),
        ("share/flexslew_lab/launch", glob("launch/*.launch.py")),
        ("share/flexslew_lab/config", glob("config/*")),
        ("share/flexslew_lab/trials", glob("flexslew_lab/trials/*.yaml")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "flexslew = flexslew_lab.cli.main:main",
            "recorder = flexslew_lab.ros.recorder_node:main",
            "play = flexslew_lab.ros.play_node:main",
            "live = flexslew_lab.ros.live_node:main",
            "console = flexslew_lab.ros.console_node:main",
        ],
        "gymnasium.envs": ["flexslew = flexslew_lab.gym.registration:register_tasks"],
    },
)
