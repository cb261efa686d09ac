"""The log: written (recording), read (bag_reader), checked (checks), recovered and exported.

messages: bytes and records; files: MCAP and the folder of rosbag2.

Offers: bag_columns, bag_index, bag_layout, bag_reader, checks.check, export, files.bag_lock,
files.mcap_scan, files.read_limits, files.whole_file, recorded_testbed, info, joints_flown,
messages.cdr,
messages.logged_event, messages.logged_text, messages.record_schema, messages.schemas,
recording.bag_observer, recording.bag_writer, recording.recording, recording.recording_order,
recording.unfinished, recover, truth_columns.
"""
