import os
import signal

import distributed
import pytest

from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.execution.cluster import Cluster
from flexslew_lab.studies.flight import FlightResult
from flexslew_lab.studies.run import PreparedStudy
from flexslew_plant.errors import BadInput, RunFault


@pytest.mark.slow
def test_a_cluster_that_loses_its_workers_flies_the_same(ready: PreparedStudy) -> None:
    cases = [case_of(ready.study, ready.samples, k) for k in range(ready.trials)]
    alone = {r.number: r for results in InThisProcess(ready.job).fly(iter(cases)) for r in results}
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as local:
        cluster = Cluster(ready.job, local.scheduler_address)
        found: dict[int, FlightResult] = {}
        for results in cluster.fly(iter(cases)):
            if not found:
                for worker in local.workers.values():
                    os.kill(worker.pid, signal.SIGKILL)
            found |= {result.number: result for result in results}
        cluster.close()
    assert found == alone


def test_a_cluster_flies_the_same_until_its_scheduler_goes_away(
    ready: PreparedStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.studies.execution.cluster._CONNECT", 5.0)
    cases = [case_of(ready.study, ready.samples, k) for k in range(ready.trials)]
    with distributed.LocalCluster(
        n_workers=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address=None,
    ) as local:
        cluster = Cluster(ready.job, local.scheduler_address)
        flights = cluster.fly(iter(cases))
        first = next(flights)
        numbers = [result.number for result in first]
        alone = InThisProcess(ready.job).fly(
            case_of(ready.study, ready.samples, k) for k in numbers
        )
        assert first == [result for results in alone for result in results]
    with pytest.raises(RunFault, match=r"the cluster is gone.*run the study again"):
        for _ in flights:
            pass
    cluster.close()


def test_nobody_at_the_address_is_one_line(
    ready: PreparedStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.studies.execution.cluster._CONNECT", 0.5)
    with pytest.raises(BadInput, match=r"127\.0\.0\.1:9: no scheduler answers") as error:
        Cluster(ready.job, "tcp://127.0.0.1:9")
    assert "\n" not in str(error.value)
