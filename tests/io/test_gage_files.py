"""Files of strains that gages showed: units, spellings, and bad ones in one sentence."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.io import read_gages


@pytest.fixture
def read(tmp_path):
    def reader(text, encoding="utf-8"):
        path = tmp_path / "g.csv"
        path.write_bytes(text.encode(encoding))
        return read_gages(path)

    return reader


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("gage,frequency_Hz,amplitude_microstrain,phase_deg,std_microstrain", "a,50,2,90,0.1"),
        (
            "gage,frequency,amplitude_um_per_m,phase_rad,std_um_per_m",
            "a,50,2,1.570796326795,.1",
        ),
        ("Gage,Frequency [Hz],Amplitude [µm/m],Phase [°],Std [µm/m]", "a,50,2,90,0.1"),
        ("gage,frequency_kHz,amplitude [m/m],phase (deg),std [m/m]", "a,0.05,2e-6,90,1e-7"),
        ("gage,frequency,real [mm/m],imag [mm/m],std [microstrain]", "a,50,0,2e-3,0.1"),
        ("gage;frequency;real [ustrain];imag [ustrain];std [ustrain]", "a;50,0;0,0;2,0;0,1"),
        ("gage\tfrequency\treal [µε]\timag [με]\tstd [%]", "a\t50\t0\t2\t1e-5"),
        ("gage,frequency,amplitude_microstrain_rms,phase_deg,std_microstrain", None),
        ("gage,frequency,amplitude [µm/m p-p],phase_deg,std [µm/m p-p]", "a,50,4,90,0.2"),
    ],
)
def test_spellings_of_one_strain(read, header, cells):
    rms = f"a,50,{2 / 2**0.5},90,{0.1 / 2**0.5}"
    found = read(f"\ufeff# some remark\n{header}\n{cells or rms}\n")
    assert found.gage == ["a"]
    assert found.frequency == pytest.approx([50.0])
    assert found.strain == pytest.approx([2e-6j])
    assert found.std == pytest.approx([1e-7])
    assert found.has_std


def test_numbers_that_are_not_there_are_missing(read):
    found = read("gage,frequency,amplitude_ustrain,phase_deg,std_ustrain\na,1,,,\na,2,1,0,0.1\n")
    assert np.isnan(found.strain).tolist() == [True, False]
    assert not read("gage,frequency,real_ustrain,imag_ustrain\na,1,1,2\n").has_std


GOOD = "gage,frequency,amplitude_ustrain,phase_deg"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the column gage is missing; needed are gage, frequency and either"),
        (GOOD, "has a header but no strains"),
        ("gage,amplitude_ustrain,phase_deg\na,1,2", "the column frequency is missing"),
        ("gage,frequency,amplitude_ustrain\na,1,2", "the column phase is missing"),
        ("gage,frequency,real_ustrain\na,1,2", "the column imag is missing"),
        (f"{GOOD},real_ustrain\na,1,2,3,4", "amplitude and real, which must not both be there"),
        (f"{GOOD},phase_rad\na,1,2,3,4", "has two columns phase"),
        ("gage,frequency,amplitude,phase_deg\na,1,2,3", "states no unit of strain, as microstrain"),
        ("gage,frequency,amplitude_mV,phase_deg\na,1,2,3", "unknown unit of strain 'mV'"),
        ("gage,frequency,amplitude_microstrian,phase_deg\na,1,2,3", "did you mean microstrain"),
        ("gage,frequency,amplitude_um,phase_deg\na,1,2,3", "unknown unit of strain 'um'"),
        ("gage,frequency,amplitude_ustrain,phase\na,1,2,3", "unknown unit ''"),
        ("gage,frequency,amplitude_ustrain,phase_m\na,1,2,3", "unknown unit 'm'"),
        ("gage,frequency_s,amplitude_ustrain,phase_deg\na,1,2,3", "'s' is none of a frequency"),
        (
            "gage,frequency,real [ustrain rms],imag [ustrain],std_ustrain\na,1,2,3,4",
            "mix peak, rms and peak-to-peak",
        ),
        (f"{GOOD}\na,1,2,x", "line 2: phase_deg must be a number, not 'x'"),
        (f"{GOOD}\na,0,2,3", "line 2: the frequency must be positive"),
        (f"{GOOD}\na,1,-2,3", "line 2: the amplitude must be zero or more"),
        (f"{GOOD},std_ustrain\na,1,2,3,-1", "line 2: std must be a number of zero or more"),
        (f"{GOOD},std_ustrain\na,1,2,3,", "line 2: std must be a number of zero or more"),
        (f"{GOOD}\n,1,2,3", "line 2: the gage has no name"),
        (f"{GOOD}\na,1,2,3\na,1,2,3", "line 3: gage a at 1 Hz stands on line 2 already"),
        ("gage,frequency,amplitude [m/m],phase_deg\na,1,2.7,3", "line 2: a strain of 2.7 is more"),
    ],
)
def test_bad_files_are_told_in_a_sentence(read, text, told):
    with pytest.raises(UserError) as raised:
        read(text)
    assert told in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1
    assert "g.csv" in str(raised.value)
