"""Campaigns: thousands of cases of a system's dispersions, on one machine or many.

plan.py     what a campaign is; a case is a function of plan and number alone
case.py     one case as a row
store.py    the folder: a journal, and Parquet files of whole blocks of cases
damaged.py  its files as they are read
cluster.py  the cases on a Dask cluster
head.py     what hands out cases and keeps rows
judged.py, figures.py, report.py, compare.py   what comes out
"""
