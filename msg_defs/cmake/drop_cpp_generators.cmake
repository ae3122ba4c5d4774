# Where no rclcpp is installed, as among the wheels of ROS 2, nothing loads the C++ code of messages,
# which takes most of the time to build: generate none there.
ament_index_has_resource(rclcpp_prefix packages rclcpp)
if(NOT rclcpp_prefix)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
endif()
