"""Fixed frame, and class and topic of each display with a topic, of a configuration file of RViz 2, as JSON.

    python rviz_displays.py plumbline.rviz
"""

import json
import sys
from pathlib import Path

from ruamel.yaml import YAML

config = YAML(typ="safe").load(Path(__file__).parents[2] / sys.argv[1])["Visualization Manager"]
displays = [
    {"class": display["Class"], "topic": display["Topic"]["Value"]}
    for display in config["Displays"]
    if "Topic" in display
]
json.dump({"fixed_frame": config["Global Options"]["Fixed Frame"], "displays": displays}, sys.stdout)
