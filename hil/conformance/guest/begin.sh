# The guest's second program, with this computer's programs: its devices, its network, and the agent.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8
set -a
. /run/guest/settings
set +a
mount --bind "$MODULES" /lib/modules
ip link set lo up
ip address add 10.0.2.15/24 dev eth0
ip link set eth0 up
modprobe vhci-hcd
modprobe cdc-acm
mkdir -p /run/udev/rules.d
cp "$RULES" /run/udev/rules.d/
udevd=/lib/systemd/systemd-udevd
[ -x $udevd ] && $udevd --resolve-names=early --daemon && udevadm trigger && udevadm settle --timeout=20
cd "$PROJECT"
exec "$PYTHON" hil/conformance/guest/agent.py "$(echo /dev/vport*p1)"
