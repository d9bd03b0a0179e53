"""A test plan: read it, put it together from what it extends, and say where each value is from."""

from station.files.plan.model import Plan, PlanHeader, plan_of, read_plan

__all__ = ["Plan", "PlanHeader", "plan_of", "read_plan"]
