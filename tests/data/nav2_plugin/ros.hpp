/* As much of ROS 2 and Nav2 as the exported controller touches: our own, to compile and drive it without either.
   With STANDS_FOR_LYRICAL the interface of nav2_core is that of Lyrical, else that of Jazzy and Kilted. */
#pragma once

#include <cmath>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#if defined(__GNUC__)
#define CHECKED_FORMAT(at) __attribute__((format(printf, at, at + 1)))
#else
#define CHECKED_FORMAT(at)
#endif

namespace builtin_interfaces::msg
{
struct Time {int32_t sec = 0; uint32_t nanosec = 0;};
}

namespace rclcpp
{
enum Type {SYSTEM = 1, ROS = 2};

class Duration
{
public:
  explicit Duration(int64_t nanoseconds) : t(nanoseconds) {}
  double seconds() const {return 1e-9 * double(t);}

private:
  int64_t t;
};

class Time
{
public:
  explicit Time(int64_t nanoseconds = 0, Type type = SYSTEM) : t(nanoseconds), kind(type) {}
  Time(const builtin_interfaces::msg::Time & x, Type type = ROS)
  : t(int64_t(x.sec) * 1000000000 + x.nanosec), kind(type) {}
  operator builtin_interfaces::msg::Time() const
  {
    return {int32_t(t / 1000000000), uint32_t(t % 1000000000)};
  }
  int64_t nanoseconds() const {return t;}
  Type get_clock_type() const {return kind;}
  Duration operator-(const Time & other) const
  {
    if (kind != other.kind) {throw std::runtime_error("times of different clocks");}
    return Duration(t - other.t);
  }

private:
  int64_t t;
  Type kind;
};

class Clock
{
public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const {return Time(t, ROS);}
  int64_t t = 100000000000;
};

class Logger
{
public:
  explicit Logger(std::string = "") {}
  CHECKED_FORMAT(2) void say(const char * format, ...) const
  {
    char text[500];
    va_list rest;
    va_start(rest, format);
    std::vsnprintf(text, sizeof text, format, rest);
    va_end(rest);
    said() += std::string(text) + "\n";
  }
  static std::string & said() {static std::string all; return all;}
};
inline Logger get_logger(const std::string & name) {return Logger(name);}
}  // namespace rclcpp

#define RCLCPP_INFO(logger, ...) (logger).say(__VA_ARGS__)
#define RCLCPP_ERROR(logger, ...) (logger).say(__VA_ARGS__)
#define RCLCPP_WARN_THROTTLE(logger, clock, milliseconds, ...) \
  do {(void)(clock); (void)(milliseconds); (logger).say(__VA_ARGS__);} while (0)

namespace rclcpp_lifecycle
{
/* Parameters are numbers, or lists of numbers: all that the controller has; a bool is 0 or 1. */
class LifecycleNode
{
public:
  using WeakPtr = std::weak_ptr<LifecycleNode>;
  using Numbers = std::vector<double>;

  rclcpp::Logger get_logger() const {return rclcpp::Logger();}
  rclcpp::Clock::SharedPtr get_clock() {return clock;}
  bool get_parameter(const std::string & name, double & value) const
  {
    const auto found = held.find(name);
    if (found == held.end()) {return false;}
    value = found->second.at(0);
    return true;
  }

  rclcpp::Clock::SharedPtr clock = std::make_shared<rclcpp::Clock>();
  std::map<std::string, Numbers> held, launched;
  std::map<std::string, std::function<std::string(const Numbers &)>> rules;  // empty: it may be set so
  long changes = 0;
};
}  // namespace rclcpp_lifecycle

namespace std_msgs::msg
{
struct Header {builtin_interfaces::msg::Time stamp; std::string frame_id;};
}

namespace geometry_msgs::msg
{
struct Vector3 {double x = 0, y = 0, z = 0;};
struct Point {double x = 0, y = 0, z = 0;};
struct Quaternion {double x = 0, y = 0, z = 0, w = 1;};
struct Pose {Point position; Quaternion orientation;};
struct Twist {Vector3 linear, angular;};
struct PoseStamped {std_msgs::msg::Header header; Pose pose;};
struct TwistStamped {std_msgs::msg::Header header; Twist twist;};
}

namespace nav_msgs::msg
{
struct Path {std_msgs::msg::Header header; std::vector<geometry_msgs::msg::PoseStamped> poses;};
}

namespace tf2
{
class TransformException : public std::runtime_error {using std::runtime_error::runtime_error;};
using Duration = int64_t;
inline Duration durationFromSec(double t) {return Duration(1e9 * t);}
}

namespace tf2_ros
{
/* One transform, from "odom" into "map": a turn, then a shift. */
class Buffer
{
public:
  template<class T>
  T transform(const T & in, const std::string & frame, tf2::Duration) const
  {
    if (in.header.frame_id != "odom" || frame != "map") {throw tf2::TransformException("no such frame");}
    T out = in;
    out.header.frame_id = frame;
    const double c = std::cos(turn), s = std::sin(turn), z = in.pose.orientation.z, w = in.pose.orientation.w;
    out.pose.position.x = x + c * in.pose.position.x - s * in.pose.position.y;
    out.pose.position.y = y + s * in.pose.position.x + c * in.pose.position.y;
    out.pose.orientation.z = w * std::sin(turn / 2) + z * std::cos(turn / 2);
    out.pose.orientation.w = w * std::cos(turn / 2) - z * std::sin(turn / 2);
    return out;
  }
  double x = 0, y = 0, turn = 0;
};
}

namespace nav2_costmap_2d
{
class Costmap2DROS
{
public:
  std::string getBaseFrameID() const {return "base_link";}
};
}

#ifdef STANDS_FOR_LYRICAL
namespace nav2
{
class LifecycleNode : public rclcpp_lifecycle::LifecycleNode
{
public:
  using WeakPtr = std::weak_ptr<LifecycleNode>;
};
}
#endif

namespace nav2_core
{
class ControllerException : public std::runtime_error {using std::runtime_error::runtime_error;};
class ControllerTFError : public ControllerException {using ControllerException::ControllerException;};
class InvalidPath : public ControllerException {using ControllerException::ControllerException;};
class NoValidControl : public ControllerException {using ControllerException::ControllerException;};

class GoalChecker
{
public:
  virtual ~GoalChecker() {}
#ifdef STANDS_FOR_LYRICAL
  virtual bool getTolerances(geometry_msgs::msg::Pose &, geometry_msgs::msg::Twist &, double &) = 0;
#else
  virtual bool getTolerances(geometry_msgs::msg::Pose &, geometry_msgs::msg::Twist &) = 0;
#endif
};

class Controller
{
public:
#ifdef STANDS_FOR_LYRICAL
  using Parent = nav2::LifecycleNode;
#else
  using Parent = rclcpp_lifecycle::LifecycleNode;
#endif
  virtual ~Controller() {}
  virtual void configure(
    const Parent::WeakPtr &, std::string, std::shared_ptr<tf2_ros::Buffer>,
    std::shared_ptr<nav2_costmap_2d::Costmap2DROS>) = 0;
  virtual void cleanup() = 0;
  virtual void activate() = 0;
  virtual void deactivate() = 0;
#ifdef STANDS_FOR_LYRICAL
  virtual void newPathReceived(const nav_msgs::msg::Path &) = 0;
  virtual geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped &, const geometry_msgs::msg::Twist &, GoalChecker *,
    const nav_msgs::msg::Path &, const geometry_msgs::msg::PoseStamped &) = 0;
#else
  virtual void setPlan(const nav_msgs::msg::Path &) = 0;
  virtual geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped &, const geometry_msgs::msg::Twist &, GoalChecker *) = 0;
#endif
  virtual bool cancel() {return true;}
  virtual void setSpeedLimit(const double &, const bool &) = 0;
  virtual void reset() {}
};
}  // namespace nav2_core

/* What pluginlib would find by its name. */
nav2_core::Controller * made();
#define PLUGINLIB_EXPORT_CLASS(kind, base) \
  base * made() {return new kind();}
