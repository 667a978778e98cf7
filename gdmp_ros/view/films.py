"""
Renders a simulated arm at given joint positions, as a picture or a film, in its own process.

The process is needed because the off-screen backend must be chosen before MuJoCo is imported.
"""
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

#: Backends for off-screen rendering in the order of trial, and their Debian packages.
BACKENDS = {'egl': 'libegl1', 'osmesa': 'libosmesa6'}
#: Exit code if another backend would not help.
_REFUSED = 3


def render_to(target: Path, joints: np.ndarray, path: np.ndarray, model: str | Path = '',
              frame_s: float = 0.05, *, whole: bool = False, caption: str = '',
              environment: Mapping[str, str] | None = None) -> str | None:
    """
    Write a picture (``.png``) or a film (``.webp``, ``.gif``, ``.mp4``).

    :param joints: one posture, shape ``(n,)``, or one for each frame of a film [rad]
    :param path: positions to draw as a line [m], shape ``(T, 3)``; most of it is seen
    :param model: MJCF file or name; the built-in Panda by default
    :param frame_s: time between the frames of a film [s]
    :param whole: whether the model is a whole world, in which ``joints`` are the positions of
        everything (`gdmp_ros.sim.two_arms`)
    :param caption: below the pictures
    :returns: what to install if off-screen rendering is not possible, otherwise None
    :raises DataError: if the film cannot be written
    """
    numbers = target.with_name(f'.{target.stem}.npz')
    np.savez(numbers, joints=joints, path=path, model=str(model), frame_s=frame_s, whole=whole,
             caption=caption)
    try:
        for backend in BACKENDS:
            done = subprocess.run(
                [sys.executable, '-m', 'gdmp_ros.view.films', str(numbers), str(target)],
                env={**(environment or os.environ), 'MUJOCO_GL': backend}, capture_output=True,
                text=True)
            if done.returncode == 0:
                return None
            output = (done.stdout.strip() or done.stderr.strip()).splitlines()
            if done.returncode == _REFUSED:
                raise DataError(output[-1])
    finally:
        numbers.unlink()
    return (f'no picture of the arm: install {" or ".join(BACKENDS.values())} '
            f'({output[-1] if output else "no reason was given"})')


def join(target: Path, films: Sequence[Path], frame_s: float, width: int) -> None:
    """
    Write films one after another as one.

    :param films: ``.webp``
    :param frame_s: time between their pictures [s]
    :param width: of the film [pixels]
    """
    from PIL import Image

    def images() -> Iterator[Any]:
        for path in films:
            with Image.open(path) as film:
                for number in range(getattr(film, 'n_frames', 1)):
                    film.seek(number)
                    height = round(width * film.height / film.width)
                    yield film.convert('RGB').resize((width, height))
    (_h264 if target.suffix == '.mp4' else _pillow)(target, images(), frame_s)


def main(numbers: str, target: str) -> int:
    """Render the postures in the file ``numbers`` of `render_to`."""
    from PIL import Image

    from gdmp_ros.sim.viewer import Camera, NoScreenError, Stage
    partial = Path(target).with_name(f'.{Path(target).stem}.partial{Path(target).suffix}')
    try:
        with np.load(numbers) as given:
            postures = np.atleast_2d(given['joints'])
            film = given['joints'].ndim == 2
            stage = (Stage.of_world if given['whole'] else Stage.of_arm)(str(given['model']))
            path = given['path']
            frame_s, caption = float(given['frame_s']), str(given['caption'])
        if postures.shape[1] != stage.model.nq:
            raise DataError(f'postures have {postures.shape[1]} joints, the model has '
                            f'{stage.model.nq}: name the model of the arm')
        encode = _h264 if partial.suffix == '.mp4' else _pillow
        with Camera(stage, (640, 480) if film else (960, 720)) as pictures:
            if len(path):
                stage.show(postures[len(postures) // 2])
                pictures.aim(path)
            def images() -> Iterator[Any]:
                for posture in postures:
                    stage.show(posture)
                    yield _with_caption(Image.fromarray(pictures.take(path)), caption)
            encode(partial, images(), frame_s)
        os.replace(partial, target)
    except NoScreenError as error:
        print(error)
        return 1
    except DataError as error:
        print(error)
        return _REFUSED
    except OSError as error:
        print(f'{target}: cannot write: {error.strerror}')
        return _REFUSED
    finally:
        partial.unlink(missing_ok=True)
    return 0


def _with_caption(image: Any, caption: str) -> Any:
    if caption:
        from PIL import ImageDraw, ImageFont
        draw, font = ImageDraw.Draw(image), ImageFont.load_default(22)
        place = 0.5 * image.width, image.height - 26
        draw.text(place, caption, fill='black', font=font, anchor='mm', stroke_width=3,
                  stroke_fill='white')
    return image


def _pillow(target: Path, images: Iterator[Any], frame_s: float) -> None:
    """Write a picture or an animated picture; images are made one at a time."""
    first = next(images)
    if target.suffix == '.gif':
        # A palette for all pictures: one for each would flicker.
        palette = first.quantize(colors=64)
        rest = (image.quantize(palette=palette) for image in images)
        palette.save(target, save_all=True, append_images=rest, duration=round(1e3 * frame_s),
                     loop=0)
    elif target.suffix == '.webp':
        first.save(target, save_all=True, append_images=images, duration=round(1e3 * frame_s),
                   loop=0, quality=70)
    else:
        first.save(target)


def _h264(target: Path, images: Iterator[Any], frame_s: float) -> None:
    """Write a film in a format that every browser plays."""
    with optional_import(extra('film')):
        import av
    rate = Fraction(1.0 / frame_s).limit_denominator(1000)
    with av.open(str(target), 'w') as out:
        stream = out.add_stream('libx264', rate=rate)
        for image in images:
            if stream.width != image.width:
                stream.width, stream.height, stream.pix_fmt = image.width, image.height, 'yuv420p'
            out.mux(stream.encode(av.VideoFrame.from_image(image)))
        out.mux(stream.encode())


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
