"""Report of one or several experiments: one self-contained HTML page that opens offline.

report = Report("Inner azimuth axis")
report.add_experiment("Linear", record, spectra, frf, model, comparison)
report.write("report.html")
"""

from gsid.report.page import Report
from gsid.report.tables import Truth

__all__ = ["Report", "Truth"]
