"""Provide results of the study that are computed when a test first reads them."""

import fcntl
from dataclasses import replace
from functools import cache

from study.run.cases import SECTIONS, load_section
from study.run.store import Results, StoredResult, save


@cache
def load_cases_by_key():
    return {case.key: case for section in SECTIONS for case in load_section(section).cases}


def parse_section_case_pairs(text):
    """Return (section, name) pairs from lines such as "V1: own round", one pair for each name."""
    rows = [line.split(": ") for line in text.strip().splitlines()]
    return [(section, name) for section, names in rows for name in names.split()]


class LazyResult:
    """Result of a case that is computed when an attribute such as `scalars` is first read.

    Its section, case name and parameters are available without computing it.
    """

    def __init__(self, results, key):
        self.key = key
        self.section, _, self.case = key.partition("/")
        self._results = results
        self.parameters = load_cases_by_key()[key].stored_parameters | results.parameters

    has = StoredResult.has

    def __getattr__(self, name):
        return getattr(self._results[self.key], name)


class ComputedResults(Results):
    """Results of the study's cases, each computed on first use and stored in a folder.

    If `parameters` are given, they replace parameters of the same names in all cases.
    """

    def __init__(self, folder, parameters=None):
        super().__init__(folder)
        self.parameters = parameters or {}

    def __getitem__(self, key):
        if key not in self and key in load_cases_by_key():
            self.folder.mkdir(parents=True, exist_ok=True)
            with (self.folder / f".{key.replace('/', '-')}").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)  # two processes that save would mix their files
                if key not in self:
                    self._compute_and_save(load_cases_by_key()[key])
        return super().__getitem__(key)

    def _compute_and_save(self, case):
        case = replace(case, parameters=case.parameters | self.parameters)
        result = case.run(**case.parameters)
        save(self.folder, case.section, case.name, result, case.stored_parameters, {})

    def section(self, section):
        return [
            LazyResult(self, key) for key in load_cases_by_key() if key.startswith(f"{section}/")
        ]
