#!/usr/bin/env bash
# Install the MQTT broker mosquitto from Debian's packages, for tests/mqtt (NAVSTACK_MQTT_TESTS=1).
set -euo pipefail

if command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ]; then
    echo "mosquitto is there"
    exit 0
fi
as_root=()
[ "$(id -u)" -eq 0 ] || as_root=(sudo)
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends mosquitto
# Debian starts it as a service; the tests start their own on a free port
if command -v systemctl > /dev/null; then "${as_root[@]}" systemctl disable --now mosquitto 2> /dev/null || true; fi
