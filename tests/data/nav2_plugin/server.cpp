/* As much of Nav2's controller server as a test needs, for ctypes: one controller, its calls in C. What is thrown comes
   back as text, with the kind of the exception. */
#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "plan.hpp"
#include "ros.hpp"

namespace
{

class Near : public nav2_core::GoalChecker
{
public:
#ifdef STANDS_FOR_LYRICAL
  bool getTolerances(geometry_msgs::msg::Pose & pose, geometry_msgs::msg::Twist &, double &) override
#else
  bool getTolerances(geometry_msgs::msg::Pose & pose, geometry_msgs::msg::Twist &) override
#endif
  {
    pose.position.x = pose.position.y = tolerance;
    return true;
  }
  double tolerance = 0.25;
};

std::unique_ptr<nav2_core::Controller> controller;
std::shared_ptr<nav2_core::Controller::Parent> node;
std::shared_ptr<tf2_ros::Buffer> tf;
Near checker;
std::string text;

template<class Call>
const char * told(Call call)
{
  text = "";
  try {
    call();
  } catch (const nav2_core::ControllerTFError & e) {
    text = std::string("ControllerTFError: ") + e.what();
  } catch (const nav2_core::InvalidPath & e) {
    text = std::string("InvalidPath: ") + e.what();
  } catch (const nav2_core::NoValidControl & e) {
    text = std::string("NoValidControl: ") + e.what();
  } catch (const nav2_core::ControllerException & e) {
    text = std::string("ControllerException: ") + e.what();
  } catch (const std::exception & e) {
    text = std::string("exception: ") + e.what();
  }
  return text.c_str();
}

geometry_msgs::msg::Quaternion turned(double heading)
{
  geometry_msgs::msg::Quaternion q;
  q.z = std::sin(heading / 2), q.w = std::cos(heading / 2);
  return q;
}

}  // namespace

extern "C" {

const char * configure(double frequency, const char * names, const double * values)
{
  node = std::make_shared<nav2_core::Controller::Parent>();
  tf = std::make_shared<tf2_ros::Buffer>();
  rclcpp::Logger::said() = "";
  node->held["controller_frequency"] = {frequency};
  for (std::string rest = names; !rest.empty(); ) {
    const auto end = rest.find(' ');
    node->launched["FollowPath." + rest.substr(0, end)] = {*values++};
    rest = end == std::string::npos ? "" : rest.substr(end + 1);
  }
  controller.reset(made());
  return told([] {
        controller->configure(node, "FollowPath", tf, std::make_shared<nav2_costmap_2d::Costmap2DROS>());
        controller->activate();
      });
}

const char * plan(const double * poses, int count, const char * frame)
{
  nav_msgs::msg::Path path;
  path.header.frame_id = frame;
  for (int i = 0; i < count; ++i) {
    geometry_msgs::msg::PoseStamped pose;
    pose.pose.position.x = poses[3 * i], pose.pose.position.y = poses[3 * i + 1];
    pose.pose.orientation = turned(poses[3 * i + 2]);
    path.poses.push_back(pose);
  }
#ifdef STANDS_FOR_LYRICAL
  return told([&] {controller->newPathReceived(path);});
#else
  return told([&] {controller->setPlan(path);});
#endif
}

/* `seen`: x, y, heading, speed, yaw rate, age of the pose; `sent`: speed and yaw rate. A period later it is called anew. */
const char * command(const double * seen, double period, double * sent)
{
  node->clock->t += int64_t(std::llround(1e9 * period));
  geometry_msgs::msg::PoseStamped pose;
  pose.header.frame_id = "odom";
  pose.header.stamp = rclcpp::Time(node->clock->t - int64_t(1e9 * seen[5]), rclcpp::ROS);
  pose.pose.position.x = seen[0], pose.pose.position.y = seen[1], pose.pose.orientation = turned(seen[2]);
  geometry_msgs::msg::Twist twist;
  twist.linear.x = seen[3], twist.angular.z = seen[4];
  sent[0] = sent[1] = 0;
  return told([&] {
#ifdef STANDS_FOR_LYRICAL
        const auto found = controller->computeVelocityCommands(pose, twist, &checker, {}, {});
#else
        const auto found = controller->computeVelocityCommands(pose, twist, &checker);
#endif
        sent[0] = found.twist.linear.x, sent[1] = found.twist.angular.z;
        if (found.header.frame_id != "base_link" || found.header.stamp.sec < 100) {text = "not stamped";}
      });
}

/* A plan as it is laid: a route in `sizes` (pieces, legs), `length` and its tables; `pace` is that of PACKAGE::Pace. */
const char * laid(
  const double * poses, int count, double spacing, int reversing, const double * pace, int * sizes, double * length,
  double * coefficients, double * squares, double * heads)
{
  return told([&] {
        std::vector<PACKAGE::Pose> given;
        for (int i = 0; i < count; ++i) {given.push_back({poses[3 * i], poses[3 * i + 1], poses[3 * i + 2]});}
        PACKAGE::Plan plan(given, spacing, reversing != 0);
        plan.drive({pace[0], pace[1], pace[2], pace[3], pace[4]});
        const auto & route = plan.route();
        sizes[0] = route.pieces, sizes[1] = route.legs, *length = route.length;
        std::copy_n(route.coefficients, 12 * route.pieces, coefficients);
        std::copy_n(route.squared_speeds, 2 * route.pieces, squares);
        std::copy_n(route.each_leg, 5 * route.legs, heads);
      });
}

/* As `ros2 param set` does: why not, or nothing. */
const char * set(const char * name, double value)
{
  const auto key = std::string("FollowPath.") + name;
  text = node->rules.at(key)({value});
  if (text.empty()) {
    node->held[key] = {value};
    ++node->changes;
  }
  return text.c_str();
}

void frames(double x, double y, double turn) {tf->x = x, tf->y = y, tf->turn = turn;}
void tolerate(double tolerance) {checker.tolerance = tolerance;}
int cancel() {return controller->cancel();}
void speed_limit(double limit, int percentage) {controller->setSpeedLimit(limit, percentage != 0);}
void reset() {controller->reset();}
void cleanup() {controller->deactivate(); controller->cleanup();}
const char * said() {return rclcpp::Logger::said().c_str();}

}
