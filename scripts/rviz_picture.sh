#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Plays a bag through bag.launch with RViz on a virtual display, and keeps what RViz shows at its
# end: scripts/rviz_picture.sh OUT.png bag:=drive.bag [scan:=...] [rate:=...]. Needs make ros, and
# Debian's rviz, xvfb and xauth, which it installs; OpenGL is Mesa's software.
#
# The picture of docs/guides/ros.md:
#   fusionslam sim house --seconds 149.6 --set robot.cameras.camera.rate_hz=4 -o house.bag
#   scripts/rviz_picture.sh docs/images/ros_rviz.png bag:=house.bag \
#     image:=/camera/rgb/image_raw/compressed rate:=3
set -euo pipefail
picture=$1
shift
here=$(dirname "$0")
bin=$here/../.venv/bin
"$here/debian.sh" rviz xvfb xauth
work=$(mktemp -d)
export ROS_HOME=$work ROS_MASTER_URI=http://127.0.0.1:11399 LIBGL_ALWAYS_SOFTWARE=1 \
  QT_X11_NO_MITSHM=1 PYTHONUNBUFFERED=1
: >"$work/said"
launch=
end() {
  [ -z "$launch" ] || kill -INT -- "-$launch" 2>/dev/null || true
  [ -z "$launch" ] || wait "$launch" || true
  rm -rf "$work"
}
trap end EXIT
trap "exit 143" TERM

# A group of its own, in which Ctrl-C is heard: what the shell starts beside itself ignores it.
set -m
xvfb-run -a -s "-screen 0 1600x1000x24 -fbdir $work" "$bin/fusionslam" \
  ros launch bag "$@" rviz:=true stay:=true -p 11399 >"$work/said" 2>&1 &
launch=$!
set +m
until grep -q "bag_player-.*process has finished cleanly" <(tr '\n' ' ' <"$work/said"); do
  kill -0 "$launch" 2>/dev/null || { tail -20 "$work/said" >&2; exit 1; }
  ! grep -q "process has died" "$work/said" || { tail -20 "$work/said" >&2; exit 1; }
  sleep 1
done
sleep 3
"$bin/python" - "$work/Xvfb_screen0" "$picture" <<'PYTHON'
"""Writes the frame buffer of Xvfb, an XWD file, as a picture."""
import sys

import numpy as np
from PIL import Image

content = open(sys.argv[1], "rb").read()
head = np.frombuffer(content, ">u4", 25)
start = int(head[0] + 12 * head[19])  # after the header and the colour map
height, line = int(head[5]), int(head[12])
pixels = np.frombuffer(content, np.uint8, height * line, start).reshape(height, -1, 4)
Image.fromarray(np.ascontiguousarray(pixels[:, : head[4], 2::-1])).save(sys.argv[2])
PYTHON
