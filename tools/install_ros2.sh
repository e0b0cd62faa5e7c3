#!/usr/bin/env bash
# Installs what the ROS 2 tests need: rclpy of Kilted and of Jazzy from PyPI's wheels, Nav2's messages compiled with gcc, each in an
# environment of its own in the cache of the user. Does nothing if they are there.
set -euo pipefail
cd "$(dirname "$0")/.."
if ! command -v g++ >/dev/null; then
  sudo=""
  [ "$(id -u)" -eq 0 ] || sudo="sudo"
  $sudo apt-get update -qq
  DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qq -y --no-install-recommends g++
fi
python3 tools/ros2_environment.py "$@"
