"""Campaigns: many cases from one, run on a laptop or a cluster, kept, resumed, and put together.

document    the campaign file              plan        its runs          identity    what a run is
validation  all that is wrong, before      truth       simulated data    execute     one run, one row
runner      chunks, processes, limits      store       journals, Parquet cluster     Dask
results     tables and groups              page        the report        commands    of the terminal
"""
