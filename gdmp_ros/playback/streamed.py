"""Chooses how a skill is streamed."""
from __future__ import annotations

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.joint_skill import is_of_joints, JointSkill
from gdmp_ros.playback.pair_skill import is_of_two_arms, PairSkill
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill
from gdmp_ros.playback.tool_skill import ToolSkill


def streamed(skill: Skill, settings: PlayerSettings) -> StreamedSkill:
    """
    A skill as a source of references.

    :raises DataError: if it is neither one of a pose, nor of two, nor of joints
    """
    if is_of_two_arms(skill):
        return PairSkill(skill, settings)
    return (JointSkill if is_of_joints(skill) else ToolSkill)(skill, settings)
