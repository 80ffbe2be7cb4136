"""`export=mp4`: the moving surface as a film, by the optional package OpenCV.

The codec is VP9, free of royalties, by libvpx (BSD). OpenCV's wheels (Apache) hold FFmpeg under the
LGPL and no H.264 encoder; those of PyAV and imageio-ffmpeg hold x264, which is under the GPL.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks, UserError
from sldvexp.export.moving_picture import MovingPicture
from sldvexp.writing import whole_or_nothing

CODEC = "vp09"


@register("export", "mp4")
@dataclass
class Mp4(MovingPicture):
    """Surface in motion at one frequency as an MP4 film (VP9), for browsers and VLC.

    Several periods, since players end at the end. Otherwise the pictures are those of `gif`, with
    all their colours. Needs OpenCV: ``pip install 'sldvexp[video]'``. Sides are even numbers.

    Parameters
    ----------
    periods : int
        That the film has.
    """

    periods: int = 2

    suffix = ".mp4"

    def check(self, checks: Checks) -> None:
        """Note sides that the codec cannot halve, and a package that is missing."""
        super().check(checks)
        for side in ("width", "height"):
            checks.require(getattr(self, side) % 2 == 0, side, "must be an even number of pixels")
        checks.require(self.periods >= 1, "periods", f"must be at least 1, not {self.periods}")
        needed = "needs the package opencv-python-headless: pip install 'sldvexp[video]'"
        checks.require(find_spec("cv2") is not None, "", needed)

    def write(self, run: RunData, path: Path) -> None:
        """Write the film.

        Raises
        ------
        UserError
            If places are not known, or the frequency, or there is no strain to be shown; or
            OpenCV was made without the codec.
        """
        import cv2

        pictures = [picture[..., ::-1] for picture in self.pictures(run, "mp4")]
        with whole_or_nothing(path) as beside:
            code, size = cv2.VideoWriter.fourcc(*CODEC), (self.width, self.height)
            film = cv2.VideoWriter(str(beside), cv2.CAP_FFMPEG, code, self.fps, size)
            if not film.isOpened():
                raise UserError("export=mp4: this OpenCV cannot write VP9; its wheels can")
            try:
                for picture in pictures * self.periods:
                    film.write(picture)
            finally:
                film.release()
