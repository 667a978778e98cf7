"""Files and data sets: rosbag2 recordings, LASA handwriting."""
