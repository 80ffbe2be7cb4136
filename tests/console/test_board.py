"""Browsers see the last word on everything and pictures as a whole, however slow they are."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from sldvexp.console.board import AT_ONCE, NoticeBoard, packed


def words(news):
    return [json.loads(each)["word"] for each in news if isinstance(each, str)]


def headers(news):
    return [
        json.loads(each[4 : 4 + struct.unpack("<I", each[:4])[0]])
        for each in news
        if isinstance(each, bytes)
    ]


def test_reader_gets_the_last_word_once():
    board = NoticeBoard()
    reader = board.reader(lambda: None)
    for k in range(5):
        board.tell("beam", k)
    assert words(board.news(reader)[0]) == [4]
    assert board.news(reader) == ([], False)
    board.tell("beam", 4)  # which is no news
    assert board.news(reader) == ([], False)


def test_picture_comes_in_its_order_a_part_at_a_time_and_begins_anew():
    board = NoticeBoard()
    reader = board.reader(lambda: None)
    board.begin("image", view="1")
    for k in range(AT_ONCE + 5):
        board.add("image", [], part=k)
    news, more = board.news(reader)
    assert (len(news), more) == (AT_ONCE, True)
    rest, more = board.news(reader)
    assert ([h["part"] for h in headers(rest)], more) == (
        list(range(AT_ONCE - 1, AT_ONCE + 5)),
        False,
    )
    board.begin("image", view="2")
    board.add("image", [], part=0)
    begun, part = headers(board.news(reader)[0])
    assert (begun["begin"], begun["view"], part["part"]) == (True, "2", 0)


def test_late_reader_sees_what_an_early_one_has_seen():
    board = NoticeBoard()
    board.tell("beam", [1, 2])
    board.begin("image")
    board.add("image", [np.arange(3, dtype=np.float32)])
    early, late = board.reader(lambda: None), board.reader(lambda: None)
    assert board.news(early) == board.news(late)


def test_readers_are_woken_until_they_leave():
    board, woken = NoticeBoard(), []
    reader = board.reader(lambda: woken.append(1))
    board.tell("beam", 1)
    board.begin("image")
    board.add("image", [])
    board.leave(reader)
    board.tell("beam", 2)
    assert len(woken) == 3


@pytest.mark.parametrize("kind", ["<i4", "<f4", "u1", ">i2"])
def test_arrays_are_packed_at_fours_with_the_low_byte_first(kind):
    array = np.array([1, 2, 100], kind)
    message = packed({"name": "ä"}, [array, array])
    (length,) = struct.unpack("<I", message[:4])
    header = json.loads(message[4 : 4 + length])
    assert length % 4 == 0
    at = 4 + length
    for told, size in header["arrays"]:
        found = np.frombuffer(message, f"<{told}", size, at)
        np.testing.assert_array_equal(found, array)
        at += -(-found.nbytes // 4) * 4
    assert at == len(message)


def test_word_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        NoticeBoard().tell("level", float("nan"))
