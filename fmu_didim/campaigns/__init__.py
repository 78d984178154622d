"""Campaigns: many cases from one, run on a laptop or a cluster, saved, resumed and summarised.

planning    document: the campaign file; plan: its runs; identity: digests of runs; truth: simulated data
validation  all errors of a campaign, before its first run
running     runner: chunks, processes, limits; execute: one run, one row; store: journals, Parquet; cluster: Dask
reporting   results: tables and groups; quality: bias, sigma, coverage; page: the report
"""
