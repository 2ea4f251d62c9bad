"""Writes the paper's scenes as OpenUSD files into a folder."""

import argparse
from pathlib import Path

from sonarwarp_scenes.assets import write_assets

parser = argparse.ArgumentParser(prog="python -m sonarwarp_scenes.assets", description=__doc__)
parser.add_argument("folder", type=Path, help="an existing folder")
for file in write_assets(parser.parse_args().folder):
    print(file)
