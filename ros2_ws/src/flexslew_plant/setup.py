from setuptools import find_packages, setup

setup(
    name="flexslew_plant",
    version="0.1.0",
    packages=find_packages(),
    package_data={
        "flexslew_plant": ["py.typed", "profiles/*.xml", "testbeds/spacecraft/data/*.yaml"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/flexslew_plant"]),
        ("share/flexslew_plant", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    license="Apache-2.0",
    entry_points={"console_scripts": ["plant = flexslew_plant.ros.plant_node:main"]},
)
