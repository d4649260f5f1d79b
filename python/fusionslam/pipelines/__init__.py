# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Process whole recordings: what commands call, and programs can.

recording and drives open DATA. describe, loops, compare_descriptors, export_folder and export_bag
work on coloured clouds; scenes, views, methods, compare_views and tuning on views; maps,
map_events and drive_images on maps. overview, bag_overview and frame_check look at a recording;
results and reusable_runs keep a folder of results.
"""
