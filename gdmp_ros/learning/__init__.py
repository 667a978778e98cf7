"""From demonstrations to skills, and to the stiffness that goes with them."""
from gdmp_ros.learning.alignment import aligned
from gdmp_ros.learning.report import Fit, fit_report
from gdmp_ros.learning.stiffness import stiffness_from_takes

__all__ = ['aligned', 'Fit', 'fit_report', 'stiffness_from_takes']
