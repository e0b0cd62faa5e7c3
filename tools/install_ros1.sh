#!/usr/bin/env bash
# Installs what the ROS 1 tests need from Debian 12: the client library, the tools, RViz and a virtual display. Does nothing
# if they are there.
set -euo pipefail
packages=(
  python3-rospy python3-rosmaster python3-roslaunch python3-rosbag python3-rostopic python3-rosnode python3-rosservice
  python3-rosparam rosout python3-actionlib python3-move-base-msgs python3-map-msgs python3-trajectory-msgs
  python3-visualization-msgs python3-diagnostic-msgs python3-std-srvs python3-dynamic-reconfigure python3-tf2-ros python3-tf
  python3-sensor-msgs python3-cv-bridge
  rviz xvfb xdotool
)
missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
[ "${#missing[@]}" -eq 0 ] && exit 0
sudo=""
[ "$(id -u)" -eq 0 ] || sudo="sudo"
$sudo apt-get update -qq
DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qq -y --no-install-recommends "${missing[@]}"
