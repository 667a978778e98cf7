"""What is around a robot, by topics: markers, MoveIt's objects, clouds of points."""
