from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.rendezvous.planner.approach import PlannerOptions, plan_approach
from safe_inspect.rendezvous.planner.problem import approach_problem
from safe_inspect.rendezvous.planner.table import PlanTable, build_table, table_queries
from safe_inspect.rendezvous.plugins import SplineSCPPlanner

pytest.importorskip("piqp")


@pytest.fixture(scope="module")
def table(query):
    return build_table(table_queries(query(0), 4))


def _problem(asked):
    return approach_problem(asked, 0.0, 60.0, 20, 121)


def test_an_entrys_own_query_starts_from_its_solution(query, table):
    asked = list(table_queries(query(0), 4))[1]
    assert len(table) == 4
    (start, *_) = table(_problem(asked))
    plan = plan_approach(asked, PlannerOptions(starts=table, multi_start=True))
    assert plan.report.cost <= table.cost[1] * 1.001
    assert np.allclose(start[3:-3], table.free_points[1])
    assert (start[:3] == _problem(asked).ends[:3]).all()


def test_a_query_of_another_target_or_far_away_has_no_neighbours(query, table):
    asked = list(table_queries(query(0), 4))[1]
    assert table(_problem(replace(asked, mating_point=np.array([0.25, 0.0, 0.43])))) == []
    assert table(_problem(replace(asked, state=np.array([0.0, -2.0, 0.0, 0.0, 0.0, 0.0])))) == []


def test_a_table_comes_back_from_its_file(table, tmp_path):
    table.save(tmp_path / "table.npz")
    back = PlanTable.load(tmp_path / "table.npz")
    assert back.key == table.key
    assert all((getattr(back, name) == value).all() for name, value in vars(table).items() if name != "key")


def test_queries_cover_attitudes_evenly(query):
    q = np.array([one.orientation for one in table_queries(query(0), 500)])
    assert np.allclose(np.linalg.norm(q, axis=1), 1.0)
    assert np.allclose(q.T @ q / 500.0, np.eye(4) / 4.0, atol=0.01)


def test_queries_of_several_targets_make_no_table(query):
    other = query(1, mating_point=np.array([0.25, 0.0, 0.43]))
    with pytest.raises(ValueError, match="must have one target"):
        build_table([query(0), other])


def test_the_planner_takes_a_table_by_its_file(query, table, tmp_path):
    table.save(tmp_path / "table.npz")
    asked = list(table_queries(query(0), 4))[1]
    plugin = SplineSCPPlanner(table=str(tmp_path / "table.npz"), multi_start=True)
    assert plugin(asked).report.starts > SplineSCPPlanner(multi_start=True)(asked).report.starts
