"""A Coupler shows what it will do: a table with a row for each subdomain."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm

TOWER_K = np.array([[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]])


def tower_and_rig(coupling="pm", **options):
    tower = pm.Subdomain([1, 2, 1], TOWER_K, scheme=pm.GeneralizedAlpha(0.8), name="tower")
    scheme = pm.GeneralizedAlpha(0.6, explicit=True)
    rig = pm.Subdomain([1.0], [4000.0], scheme=scheme, substeps=20, name="rig")
    return pm.Coupler(
        [tower, rig], pm.tie(tower, [0], rig, [0]), dt=0.05, coupling=coupling, **options
    )


def table(coupler):
    """The rows of the repr by subdomain, as dicts by heading."""
    headings, *rows = (re.split(r" {2,}", line.strip()) for line in repr(coupler).split("\n")[1:])
    return {row[0]: dict(zip(headings, row, strict=True)) for row in rows}


def test_the_step_of_a_double_step_subdomain_is_twice_its_substep():
    rows = table(tower_and_rig())
    assert (rows["tower"]["step"], rows["tower"]["double"]) == ("0.1", "yes")
    assert (rows["rig"]["step"], rows["rig"]["double"]) == ("0.0025", "no")
    assert rows["rig"]["substeps"] == "20"
    alone = table(tower_and_rig(coupling="gc"))
    assert (alone["tower"]["step"], alone["tower"]["double"]) == ("0.05", "no")


def test_scheme_and_rho_are_those_of_the_subdomain():
    rows = table(tower_and_rig())
    assert rows["tower"]["scheme"] == "GeneralizedAlpha, implicit" and rows["tower"]["rho"] == "0.8"
    assert rows["rig"]["scheme"] == "GeneralizedAlpha, explicit" and rows["rig"]["rho"] == "0.6"
    # HHT-alpha: rho = (1 - alpha) / (1 + alpha), Hilber, Hughes and Taylor 1977
    made = pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=pm.HHT(0.2), name="x")], dt=0.1)
    assert float(table(made)["x"]["rho"]) == pytest.approx(0.8 / 1.2, abs=5e-4)


def test_the_step_is_compared_with_the_critical_step():
    # Omega_s of docs/method.md at rho = 0.6; omega = sqrt(4000 / 1)
    rho = 0.6
    limit = np.sqrt(12 * (1 + rho) * (2 - rho) / (10 - 5 * rho + rho**2)) / np.sqrt(4000.0)
    rows = table(tower_and_rig())
    assert float(rows["rig"]["step / critical"]) == pytest.approx(0.0025 / limit, rel=5e-3)
    assert rows["tower"]["step / critical"] == "no limit"


def test_a_large_subdomain_shows_a_bound_without_eigenvalues(monkeypatch):
    def refused(*_):
        raise AssertionError("an eigenvalue problem was solved")

    n = 1000
    K = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    chain = pm.Subdomain(np.ones(n), K, scheme=pm.CentralDifference(), name="chain")
    monkeypatch.setattr("pmalpha.setup.stability.largest_eigenvalue", refused)
    shown = table(pm.Coupler([chain], dt=0.5))["chain"]
    # row sums give omega <= 2, and central difference is stable up to omega h = 2
    assert shown["step / critical"] == "<= 0.5"
    assert shown["factor"] == "diagonal, 1000"


def test_a_restoring_function_without_estimated_stiffness_has_no_known_critical_step():
    part = pm.Subdomain(
        [1.0], [1.0], scheme=pm.CentralDifference(), restoring=lambda t, u, v: u, name="part"
    )
    assert table(pm.Coupler([part], dt=0.5))["part"]["step / critical"] == "-"


def test_a_step_above_the_critical_one_shows_by_how_much():
    part = pm.Subdomain([1.0], [4.0], scheme=pm.CentralDifference(), name="part")
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([part], dt=1.5)
    assert table(coupler)["part"]["step / critical"] == "1.5"


def test_form_and_entries_of_the_factor_are_shown():
    assert table(tower_and_rig())["tower"]["factor"] == "dense, 6"
    n = 50
    K = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    chain = pm.Subdomain(np.ones(n), K, scheme=pm.Newmark(), name="chain")
    # a chain has no fill: one entry below each pivot but the last; a band stores that one as zero
    assert table(pm.Coupler([chain], dt=0.1))["chain"]["factor"] in ("band, 100", "columns, 99")


def test_each_subdomain_has_a_thread():
    parts = [pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name=name) for name in "ab"]
    coupler = pm.Coupler(
        parts, pm.tie(parts[0], [0], parts[1], [0]), dt=0.1, threads=2, coupling="pm"
    )
    assert {row["thread"] for row in table(coupler).values()} == {"0", "1"}
    assert {row["thread"] for row in table(tower_and_rig(threads=1)).values()} == {"0"}


def test_rows_shared_by_all_threads_are_shown_as_all():
    n = 400_000  # several ranges of rows, each worth a worker (W3)
    part = pm.Subdomain(np.ones(n), np.ones(n), scheme=pm.CentralDifference(), name="part")
    coupler = pm.Coupler([part], dt=0.1, threads=2)
    assert coupler.threads == 2 and table(coupler)["part"]["thread"] == "all"


def test_dt_coupling_and_subdomains_are_those_given():
    coupler = tower_and_rig(coupling="macro")
    assert (coupler.dt, coupler.coupling) == (0.05, "macro")
    assert [s.name for s in coupler.subdomains] == ["tower", "rig"]
    with pytest.raises(AttributeError):
        coupler.dt = 0.1


class Cells(HTMLParser):
    def __init__(self):
        super().__init__()
        self.rows, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        self.inside = tag in ("td", "th")
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.rows[-1].append(data)


def test_a_notebook_shows_the_same_table():
    coupler = tower_and_rig()
    cells = Cells()
    cells.feed(coupler._repr_html_())
    lines = repr(coupler).split("\n")[1:]
    assert cells.rows == [re.split(r" {2,}", line.strip()) for line in lines]


def test_a_name_cannot_write_html():
    part = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="<script>")
    assert "<script>" not in pm.Coupler([part], dt=0.1)._repr_html_()


def test_the_table_does_not_disturb_a_run():
    plain, shown = tower_and_rig(), tower_and_rig()
    repr(shown)
    plain.step(5), shown.step(5)
    repr(shown)
    assert np.array_equal(plain.state("rig").u, shown.state("rig").u)
