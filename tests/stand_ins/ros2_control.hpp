// What the controller of docs/howto/ros2-control.md uses from ROS 2 Jazzy, declared so that it can be compiled and
// stepped without. Names and types are ROS's, what is behind them is not.
#pragma once

#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace rclcpp {
struct Time {};

struct Duration {
    double value;
    double seconds() const { return value; }
};

struct Parameter {
    std::variant<double, std::vector<double>, std::vector<std::string>> value;
    double as_double() const { return std::get<0>(value); }
    std::vector<double> as_double_array() const { return std::get<1>(value); }
    std::vector<std::string> as_string_array() const { return std::get<2>(value); }
};
} // namespace rclcpp

namespace rclcpp_lifecycle {
struct State {};

struct LifecycleNode {
    std::map<std::string, rclcpp::Parameter> parameters;
    rclcpp::Parameter get_parameter(const std::string &name) const { return parameters.at(name); }
};
} // namespace rclcpp_lifecycle

namespace hardware_interface {
struct Handle {
    std::optional<double> value;
    std::optional<double> get_optional() const { return value; }
    [[nodiscard]] bool set_value(double given)
    {
        value = given;
        return true;
    }
};
} // namespace hardware_interface

namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };

struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names = {};
};

class ControllerInterface {
  public:
    virtual ~ControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }

    template <typename T> void auto_declare(const std::string &name, const T &otherwise)
    {
        node_->parameters.try_emplace(name, rclcpp::Parameter{otherwise});
    }

    std::vector<hardware_interface::Handle> command_interfaces_, state_interfaces_;

  private:
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
} // namespace controller_interface

#define PLUGINLIB_EXPORT_CLASS(type, base)                                                                             \
    std::unique_ptr<base> exported() { return std::make_unique<type>(); }
