"""Run campaigns: thousands of cases of a system's dispersions, on one machine or many.

plan.py     the definition of a campaign; a case is a function of plan and number alone
case.py     one case as a row
store.py    the folder: Parquet files of full blocks of cases, journals of the others
cluster.py  the cases on a Dask cluster
coordinator.py  hands out cases and keeps rows
draws.py, pairs.py  draws and sweeps in memory, and pairs
spread.py   the spread of a number over runs
judged.py, report.py  the results
"""
