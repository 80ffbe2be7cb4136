"""Who may come to the console and who may steer it, as a browser and a stranger would try."""

from __future__ import annotations

import http.client
import queue
import socket

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from sldvexp.console.server import LONGEST, LOST, Server
from sldvexp.errors import UserError
from tests.console.conftest import PATIENCE


def get(server, path, host=None, method="GET"):
    line = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)
    line.request(method, path, headers={"Host": host} if host else {})
    answer = line.getresponse()
    body = answer.read().decode()
    line.close()
    return answer, body


def test_page_comes_with_the_token_and_forbids_whatever_it_does_not_need(server):
    answer, body = get(server, f"/{server.token}/")
    assert (answer.status, "<title>sldvexp console</title>" in body) == (200, True)
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["x-frame-options"] == "DENY"
    assert answer.headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    "name", ["main.js", "aim.js", "scan.js", "link.js", "cells.js", "icon.svg"]
)
def test_files_of_the_page_come(server, name):
    assert get(server, f"/{server.token}/{name}")[0].status == 200


@pytest.mark.parametrize(
    "path",
    ["/", "/wrong/", "/wrong/main.js", "/{token}", "/{token}/secret", "/{token}/..%2fserver.py",
     "/{token}/%2e%2e/server.py", "/{token}/run.html", "/wrong/run.html"],
)  # fmt: skip
def test_nothing_else_comes(server, path):
    answer, body = get(server, path.format(token=server.token))
    assert answer.status in (307, 404)
    assert "import" not in body


def test_page_of_a_run_is_looked_for_only_for_who_knows_the_token(board, wishes):
    asked = []
    with Server(board, wishes, lambda: asked.append("run")) as server:
        assert get(server, "/wrong/run.html")[0].status == 404
        assert asked == []
        assert get(server, f"/{server.token}/run.html")[0].status == 404
    assert asked == ["run"]


def test_figure_of_the_plan_comes_when_there_is_one(board, wishes):
    figures = [(b"", b"")]
    with Server(board, wishes, lambda: None, lambda narrow: figures[-1][narrow]) as server:
        assert get(server, f"/{server.token}/plan.png?1")[0].status == 404
        figures.append((b"picture", b"narrow"))
        answer, body = get(server, f"/{server.token}/plan.png?2")
        assert (answer.status, answer.headers["content-type"], body) == (
            200,
            "image/png",
            "picture",
        )
        assert get(server, f"/{server.token}/narrow_plan.png?2")[1] == "narrow"
        assert get(server, "/wrong/plan.png")[0].status == 404


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost:80:80", "x"])
def test_another_name_for_this_machine_is_refused(server, host):
    assert get(server, f"/{server.token}/", host)[0].status == 421


@pytest.mark.parametrize("host", ["localhost:9000", "127.0.0.1:1", "[::1]:8000", "localhost"])
def test_other_ports_of_a_forward_are_taken(server, host):
    assert get(server, f"/{server.token}/", host)[0].status == 200


def test_browser_joins_through_a_port_forward_under_its_own_name(join):
    heard = join(origin="http://localhost:9000", host="localhost:9000")
    heard.until(lambda: heard.role == "watcher")


@pytest.mark.parametrize(
    "stranger",
    [
        {"token": "wrong"},
        {"origin": "http://evil.example"},
        {"origin": None},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:1"},
        {"host": "evil.example"},
    ],
    ids=str,
)
def test_stranger_is_refused(join, wishes, stranger):
    with pytest.raises(InvalidStatus) as refused:
        join(**stranger)
    assert refused.value.response.status_code in (403, 421)
    assert wishes.empty()


def test_first_who_asks_steers_and_a_second_one_is_refused(join, wishes):
    one, other = join(), join()
    one.wish("take")
    one.until(lambda: one.role == "controller")
    other.wish("take")
    other.until(lambda: other.refused)
    assert other.role == "watcher"
    assert other.refused == ["Somebody else is steering; you are watching."]
    assert wishes.get(timeout=PATIENCE) == {"do": "taken"}
    assert wishes.empty()


def test_watcher_cannot_steer(join, wishes):
    watcher = join()
    for what in ("move", "scan", "stop", "lost", "mark"):
        watcher.wish(what, to=[1, 2])
    watcher.until(lambda: len(watcher.refused) == 5)
    assert wishes.empty()


def test_who_steers_is_heard_and_what_is_no_wish_is_refused(join, wishes):
    one = join()
    one.wish("take")
    one.wish("move", to=[1, 2])
    one.line.send("no JSON")
    one.line.send("[1, 2]")
    one.line.send('{"do": 3}')
    one.wish("lost")
    one.until(lambda: len(one.refused) == 4)
    assert [wishes.get(timeout=PATIENCE) for _ in range(2)] == [
        {"do": "taken"},
        {"do": "move", "to": [1, 2]},
    ]
    assert wishes.empty()


def test_bench_hears_that_the_connection_has_dropped_and_the_next_one_may_steer(join, wishes):
    one, other = join(), join()
    one.wish("take")
    one.wish("hold", by=[1, 0])
    one.until(lambda: one.role == "controller")
    one.line.socket.shutdown(socket.SHUT_RDWR)  # without a word
    assert [wishes.get(timeout=PATIENCE)["do"] for _ in range(3)] == ["taken", "hold", "lost"]
    other.until(lambda: other.topics.get("who") == {"steered": False, "browsers": 1})
    other.wish("take")
    other.until(lambda: other.role == "controller")


def test_silence_of_a_connection_is_noticed(join, wishes, monkeypatch):
    one = join()
    one.wish("take")
    one.until(lambda: one.role == "controller")
    # A tunnel that is cut says nothing: the bytes of this browser stop, its socket stays open.
    monkeypatch.setattr(one.line.protocol, "data_to_send", lambda: [])
    assert wishes.get(timeout=PATIENCE) == {"do": "taken"}
    assert wishes.get(timeout=PATIENCE) == LOST


def test_who_leaves_control_is_heard_no_more(join, wishes):
    one = join()
    one.wish("take")
    one.wish("leave")
    one.wish("move", to=[0, 0])
    one.until(lambda: one.refused)
    assert [wishes.get(timeout=PATIENCE)["do"] for _ in range(2)] == ["taken", "lost"]
    assert wishes.empty()


def test_wish_that_is_too_long_ends_the_connection(join, wishes):
    one = join()
    one.wish("take")
    one.until(lambda: one.role == "controller")
    one.wish("move", to="x" * (2 * LONGEST))
    with pytest.raises(ConnectionClosed):
        one.until(lambda: False)
    assert [wishes.get(timeout=PATIENCE)["do"] for _ in range(2)] == ["taken", "lost"]


def test_browsers_see_the_last_word_and_the_whole_picture_whenever_they_come(join, board):
    early = join()
    for k in range(100):
        board.tell("beam", k)
    board.begin("raster", view="1")
    for k in range(200):
        board.add("raster", [], part=k)
    late = join()
    for heard in (early, late):
        heard.until(lambda heard=heard: len(heard.pictures) == 201)
        heard.until(lambda heard=heard: heard.topics.get("beam") == 99)


def test_port_that_is_taken_is_told(server, board):
    with pytest.raises(UserError, match=f"cannot listen on 127.0.0.1, port {server.port}"):
        Server(board, queue.Queue(), lambda: None, port=server.port)
