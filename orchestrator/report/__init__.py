"""What is made of runs for people and other programs: report, export, data sets."""
