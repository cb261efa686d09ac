"""The log: written (recording), read (bag_reader), checked (checks), recovered and exported.

messages: bytes and records; files: MCAP and the folder of rosbag2.
"""
