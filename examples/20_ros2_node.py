"""A ROS 2 node that plans: depth image in, grasp and motion to its pre-grasp out.

Importing it needs no ROS; `answer` takes anything with the fields of the messages.
Run, with ROS 2: python examples/20_ros2_node.py SITE.yaml
"""

import sys

import debrisgrasp
from debrisgrasp import Pipeline, Settings, ros


def answer(pipeline: Pipeline, image, info, transform):
    """Fields of PoseStamped and JointTrajectory, and in words what is missing.

    Messages: sensor_msgs/Image, sensor_msgs/CameraInfo, geometry_msgs/Transform.
    """
    capture = ros.capture_of(image, info, ros.pose_of(transform))
    result = pipeline.plan(capture)
    if not result.plan.grasps:
        return None, None, result.plan.why_empty
    motions = debrisgrasp.plan_motion(result)
    if motions.chosen is None:
        best = result.plan.grasps[0].T_base_hand
        return ros.pose_stamped(best), None, motions.why_none
    reach = motions.chosen.trajectories["reach"]
    pose = ros.pose_stamped(motions.chosen.grasp.T_base_hand)
    return pose, ros.joint_trajectory(reach), ""


def main() -> None:
    import rclpy
    from geometry_msgs.msg import PoseStamped
    from rclpy.node import Node
    from rosidl_runtime_py import set_message_fields
    from sensor_msgs.msg import CameraInfo, Image
    from std_srvs.srv import Trigger
    from tf2_ros import Buffer, TransformException, TransformListener
    from trajectory_msgs.msg import JointTrajectory

    class PlannerNode(Node):
        def __init__(self, pipeline: Pipeline) -> None:
            super().__init__("debrisgrasp")
            self.pipeline, self.seen = pipeline, {}
            self.tf = Buffer()
            self.listener = TransformListener(self.tf, self)
            self.create_subscription(Image, "depth/image_rect", self.keep, 1)
            self.create_subscription(CameraInfo, "depth/camera_info", self.keep, 1)
            self.grasp = self.create_publisher(PoseStamped, "grasp", 1)
            self.motion = self.create_publisher(JointTrajectory, "motion", 1)
            self.create_service(Trigger, "plan", self.plan)

        def keep(self, message) -> None:
            self.seen[type(message)] = message

        def plan(self, _request, response):
            pose, motion, why = None, None, "no image, or no camera info, has come yet"
            if len(self.seen) == 2:
                image, info = self.seen[Image], self.seen[CameraInfo]
                at = image.header
                try:
                    T = self.tf.lookup_transform("base", at.frame_id, at.stamp)
                    pose, motion, why = answer(self.pipeline, image, info, T.transform)
                except (debrisgrasp.DebrisGraspError, TransformException) as error:
                    why = str(error)
            for publisher, message, fields in (
                (self.grasp, PoseStamped(), pose),
                (self.motion, JointTrajectory(), motion),
            ):
                if fields is not None:
                    set_message_fields(message, fields)
                    publisher.publish(message)
            response.success, response.message = pose is not None, why
            return response

    rclpy.init()
    rclpy.spin(PlannerNode(Pipeline.from_settings(Settings.load(sys.argv[1]))))


if __name__ == "__main__":
    main()
