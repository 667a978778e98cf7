// What a controller must check before it follows a reference. It needs no ROS.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string>

namespace gdmp_client
{

enum class Mode : std::uint8_t { Streaming = 0, Holding = 1, Ended = 2 };

struct Reference
{
  std::string frame;
  double stamp;                       // [s]
  std::uint64_t sequence;
  Mode mode;
  std::array<double, 7> pose;         // x, y, z [m], qw, qx, qy, qz
  std::array<double, 36> stiffness;   // row by row [N/m, Nm/rad]
};

struct Limits
{
  std::string frame{"panda_link0"};
  double age{0.5};                    // older references, and newer ones, are refused [s]
  double step{0.05};                  // largest step between two references [m]
  double stiffness{5000.0};           // largest entry of the stiffness
};

// Accepts references of one publisher, one after the other.
class Guard
{
public:
  explicit Guard(Limits limits) : limits_(std::move(limits)) {}

  // Why a reference is refused; empty if it is accepted. `now` is on the clock of its stamp [s].
  std::string check(const Reference & reference, double now)
  {
    if (reference.frame != limits_.frame) {
      return "frame " + reference.frame + ", expected " + limits_.frame;
    }
    for (double value : reference.pose) {
      if (!std::isfinite(value)) {return "pose is not finite";}
    }
    for (double value : reference.stiffness) {
      if (!(std::abs(value) <= limits_.stiffness)) {return "stiffness out of range";}
    }
    double square = 0.0;
    for (int i = 3; i < 7; ++i) {square += reference.pose[i] * reference.pose[i];}
    if (std::abs(square - 1.0) > 1e-3) {return "not a unit quaternion";}
    if (std::abs(now - reference.stamp) > limits_.age) {return "stamp of another time";}
    if (known_) {
      if (reference.sequence <= last_.sequence) {return "sequence does not increase";}
      double away = 0.0;
      for (int i = 0; i < 3; ++i) {
        away += (reference.pose[i] - last_.pose[i]) * (reference.pose[i] - last_.pose[i]);
      }
      if (std::sqrt(away) > limits_.step) {return "jump of the pose";}
    }
    last_ = reference;
    // After the end of a stream another one may begin elsewhere.
    known_ = reference.mode != Mode::Ended;
    return "";
  }

private:
  Limits limits_;
  Reference last_{};
  bool known_{false};
};

}  // namespace gdmp_client
