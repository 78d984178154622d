"""BLAS has one thread in the tests: with more, tests side by side wait for each other, actively."""

from __future__ import annotations

from threadpoolctl import threadpool_info


def test_blas_has_one_thread() -> None:
    assert {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"} == {1}
