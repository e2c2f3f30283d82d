/* The type support of tf2_msgs/msg/TFMessage where only the wheels of ROS are installed, which do
 * not have it: that of another type, for ends of serialised messages. */
const void *rosidl_typesupport_c__get_message_type_support_handle__geometry_msgs__msg__PoseArray(void);

__attribute__((visibility("default"))) const void *
rosidl_typesupport_c__get_message_type_support_handle__tf2_msgs__msg__TFMessage(void);

const void *rosidl_typesupport_c__get_message_type_support_handle__tf2_msgs__msg__TFMessage(void)
{
  return rosidl_typesupport_c__get_message_type_support_handle__geometry_msgs__msg__PoseArray();
}
