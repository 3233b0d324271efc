"""Corner ids on boards with codes: photographs, degraded ones, videos, rendered boards, and pictures without codes."""

from rcdn_lab.coded.goals import goals, record
from rcdn_lab.coded.readers import contestants
from rcdn_lab.coded.run import PARTS, Plan, parts_of, settings_of, shown, table

__all__ = ["PARTS", "Plan", "contestants", "goals", "parts_of", "record", "settings_of", "shown", "table"]
