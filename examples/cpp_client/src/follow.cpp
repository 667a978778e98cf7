// Subscribes the references of a trajectory server, checks them, and hands them to a controller.
#include <algorithm>
#include <chrono>
#include <memory>

#include "gdmp_client/guard.hpp"
#include "gdmp_msgs/msg/reference.hpp"
#include "rclcpp/rclcpp.hpp"

using gdmp_client::Guard;
using gdmp_client::Limits;
using gdmp_client::Mode;
using gdmp_client::Reference;

class Follow : public rclcpp::Node
{
public:
  Follow() : Node("follow"), guard_(limits())
  {
    // Reliable and keep last 20, as the arms of gdmp_ros: no reference is lost in a short stall.
    subscription_ = create_subscription<gdmp_msgs::msg::Reference>(
      "trajectory_server/reference", rclcpp::QoS(20),
      [this](const gdmp_msgs::msg::Reference & message) {receive(message);});
    timer_ = create_wall_timer(std::chrono::milliseconds(50), [this] {watch();});
  }

private:
  Limits limits()
  {
    Limits result;
    result.frame = declare_parameter("frame_id", result.frame);
    return result;
  }

  void receive(const gdmp_msgs::msg::Reference & message)
  {
    Reference reference;
    reference.frame = message.header.frame_id;
    reference.stamp = rclcpp::Time(message.header.stamp).seconds();
    reference.sequence = message.sequence;
    reference.mode = static_cast<Mode>(message.mode);
    const auto & place = message.pose.position;
    const auto & turn = message.pose.orientation;
    reference.pose = {place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z};
    std::copy(message.stiffness.begin(), message.stiffness.end(), reference.stiffness.begin());
    const auto problem = guard_.check(reference, now().seconds());
    if (!problem.empty()) {
      RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 1000, "refused: %s", problem.c_str());
      return;
    }
    heard_ = now();
    if (reference.mode == Mode::Ended) {stop("the stream has ended");} else {follow(reference);}
  }

  // Without references for 100 ms the arm must come to rest by itself.
  void watch()
  {
    if (following_ && now() - heard_ > rclcpp::Duration::from_seconds(0.1)) {
      stop("no reference for 100 ms");
    }
  }

  void follow(const Reference & reference)
  {
    following_ = true;
    // Here your controller takes the pose and the stiffness.
    RCLCPP_INFO_THROTTLE(
      get_logger(), *get_clock(), 1000, "%.3f %.3f %.3f m, %.0f N/m", reference.pose[0],
      reference.pose[1], reference.pose[2], reference.stiffness[0]);
  }

  void stop(const char * reason)
  {
    if (following_) {RCLCPP_INFO(get_logger(), "hold: %s", reason);}
    following_ = false;
    // Here your controller comes to rest, and holds.
  }

  Guard guard_;
  rclcpp::Time heard_{0, 0, RCL_ROS_TIME};
  bool following_{false};
  rclcpp::Subscription<gdmp_msgs::msg::Reference>::SharedPtr subscription_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<Follow>());
  rclcpp::shutdown();
  return 0;
}
