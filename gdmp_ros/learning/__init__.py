"""From demonstrations to skills, and to the stiffness that goes with them."""
from gdmp_ros.learning.report import Fit, fit_report

__all__ = ['Fit', 'fit_report']
