"""Why a Ray cluster cannot be joined is one line, soon."""

import pytest
from uav_collect.errors import ClusterError
from uav_collect.studies.jobs.cluster_address import check_address, reason_in

TOKEN = (
    '[2026-11-30 09:44:30,990 W 13462 13462] gcs_client.cc:210: Failed to get cluster ID from GCS'
    ' server: Unauthenticated: RPC error: InvalidAuthToken: Authentication token is missing or'
    ' incorrect'
)
VERSIONS = (
    'RuntimeError Version mismatch: The cluster was started with: Ray: 2.60.0 Python: 3.12.7 This'
    ' process on node 192.0.2.2 was started with: Ray: 2.60.0 Python: 3.11.7'
)


def test_a_cluster_with_a_token_asks_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('RAY_AUTH_MODE', raising=False)
    assert reason_in(TOKEN) == (
        'asks for a token: set RAY_AUTH_MODE=token, and the token by RAY_AUTH_TOKEN,'
        ' RAY_AUTH_TOKEN_PATH or ~/.ray/auth_token'
    )


def test_a_wrong_token_is_called_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('RAY_AUTH_MODE', 'token')
    assert 'the token is wrong' in str(reason_in(TOKEN))


def test_other_versions_are_named() -> None:
    assert reason_in(VERSIONS) == VERSIONS.removeprefix('RuntimeError ')


def test_what_only_informs_is_no_reason() -> None:
    assert reason_in('2026-11-30 09:44:28,310\tINFO worker.py:2038 -- Connected to Ray.') is None


def test_where_no_cluster_is_says_so() -> None:
    pytest.importorskip('ray', reason='needs what requirements/cluster.txt lists')
    with pytest.raises(ClusterError, match=r'^--address 127\.0\.0\.1:1: no cluster answers there'):
        check_address('127.0.0.1:1')


def test_a_token_that_is_nowhere_is_missed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    pytest.importorskip('ray', reason='needs what requirements/cluster.txt lists')
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.setenv('RAY_AUTH_MODE', 'token')
    for name in ('RAY_AUTH_TOKEN', 'RAY_AUTH_TOKEN_PATH'):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ClusterError, match='RAY_AUTH_MODE is token, but there is no token'):
        check_address('127.0.0.1:1')
