"""Layer 4: motion under load. Legs, contact, grips, compliance, and what stops them.

Every step is a pure function of state and reading; nothing here has a clock.
"""

from .baseline import BaselineConfig, BaselineLook, BaselineVerdict, judge_baseline
from .compliance import Compliance, DeflectionMode, TaskFrame
from .contact import ContactGuard
from .controller import LegController
from .faults import Fault, FaultClass, Stop
from .filters import REFERENCE_SAMPLES, WrenchFilter, reference_wrench
from .grip import (
    FingerReading,
    GripCommand,
    GripConfig,
    GripController,
    GripPhase,
    GripState,
)
from .identification import ToolFit, felt_weight, identify_payload, identify_tool
from .leg_state import (
    Command,
    ControllerConfig,
    Engagement,
    LegOutcome,
    LegState,
    TarePolicy,
)
from .legs import CartesianLeg, LegPlan, LegPlanner, LegStatus
from .loads import Body, LoadModel
from .oscillation import OscillationGuard, OscillationState
from .posture import PostureKinematics
from .preview import Preview, preview
from .pull import PullChoice, PullConfig, choose_pull
from .readings import BiasBound, Reading, SafetyConfig, SafetyState, Verdict
from .refusals import Refusal, RefusalCause, StartError
from .rehearsal import LaggingArm, PressResult, Rehearsal, press, rehearse
from .servo import CartesianServo, ServoConfig, ServoState
from .stability import (
    ArmResponse,
    Contact,
    StabilityBound,
    StabilityVerdict,
    contact_gain,
)
from .supervisor import Supervisor, require_sensor_range

__all__ = [
    "REFERENCE_SAMPLES",
    "ArmResponse",
    "BaselineConfig",
    "BaselineLook",
    "BaselineVerdict",
    "BiasBound",
    "Body",
    "CartesianLeg",
    "CartesianServo",
    "Command",
    "Compliance",
    "Contact",
    "ContactGuard",
    "ControllerConfig",
    "DeflectionMode",
    "Engagement",
    "Fault",
    "FaultClass",
    "FingerReading",
    "GripCommand",
    "GripConfig",
    "GripController",
    "GripPhase",
    "GripState",
    "LaggingArm",
    "LegController",
    "LegOutcome",
    "LegPlan",
    "LegPlanner",
    "LegState",
    "LegStatus",
    "LoadModel",
    "OscillationGuard",
    "OscillationState",
    "PostureKinematics",
    "PressResult",
    "Preview",
    "PullChoice",
    "PullConfig",
    "Reading",
    "Refusal",
    "RefusalCause",
    "Rehearsal",
    "SafetyConfig",
    "SafetyState",
    "ServoConfig",
    "ServoState",
    "StabilityBound",
    "StabilityVerdict",
    "StartError",
    "Stop",
    "Supervisor",
    "TarePolicy",
    "TaskFrame",
    "ToolFit",
    "Verdict",
    "WrenchFilter",
    "choose_pull",
    "contact_gain",
    "felt_weight",
    "identify_payload",
    "identify_tool",
    "judge_baseline",
    "press",
    "preview",
    "reference_wrench",
    "rehearse",
    "require_sensor_range",
]
