#!/bin/busybox sh
# The guest's first program: it lays a file system in memory over the computer's, and hands over to the agent there.
/bin/busybox --install -s /bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
while read module; do insmod "/modules/$module"; done < /modules/order
mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=524288 host /host
mount -t tmpfs over /run
mkdir /run/upper /run/work
mount -t overlay -o lowerdir=/host,upperdir=/run/upper,workdir=/run/work over /new
for place in proc sys dev; do mount --move "/$place" "/new/$place"; done
mount -t tmpfs run /new/run
mkdir -p /new/run/guest /new/dev/pts /new/lib/modules /new/dev/shm
mount -t devpts pts /new/dev/pts
mount -t tmpfs shm /new/dev/shm
mount -t 9p -o trans=virtio,version=9p2000.L,msize=524288 work /new/run/guest
exec switch_root /new /bin/sh /run/guest/begin.sh
