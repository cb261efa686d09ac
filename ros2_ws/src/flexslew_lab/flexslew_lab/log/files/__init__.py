"""The files of a bag: MCAP records, their index, the folder of rosbag2; what is there is whole."""
