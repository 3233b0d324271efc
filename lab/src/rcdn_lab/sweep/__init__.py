"""Rendered boards with exact truth, one factor at a time: `rcdn evaluate sweep`."""

from rcdn_lab.sweep.pictures import picture, scene
from rcdn_lab.sweep.run import contestants, settings_of, table
from rcdn_lab.sweep.settings import FACTORS, Setting

__all__ = ["FACTORS", "Setting", "contestants", "picture", "scene", "settings_of", "table"]
