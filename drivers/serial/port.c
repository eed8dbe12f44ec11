#include "port.h"

#include "drivers/device.h"
#include "modbus/serial.h"

#include <asm/termbits.h>
#include <errno.h>
#include <sys/ioctl.h>
#include <unistd.h>

/* Sets speed and raw mode. termios2 is used because its speed is a number, and many boards with
 * Marlin use 250000. */
static gboolean set_raw(int fd, int baud) {
    struct termios2 settings;
    if (ioctl(fd, TCGETS2, &settings) < 0)
        return FALSE;
    settings.c_iflag = IGNBRK;
    settings.c_oflag = 0;
    settings.c_lflag = 0;
    settings.c_cflag = BOTHER | CS8 | CREAD | CLOCAL | HUPCL;
    settings.c_ispeed = settings.c_ospeed = (speed_t)baud;
    settings.c_cc[VMIN] = 1;
    settings.c_cc[VTIME] = 0;
    return ioctl(fd, TCSETS2, &settings) == 0 && ioctl(fd, TCFLSH, TCIOFLUSH) == 0;
}

int serial_port_open(const char *path, int baud, GError **error) {
    int fd = modbus_serial_take(path);
    if (fd >= 0 && set_raw(fd, baud))
        return fd;
    const int why = errno;
    if (fd >= 0)
        close(fd);
    if (why == EWOULDBLOCK) {
        g_autofree char *holder = modbus_serial_holder(path);
        const gboolean daemon = holder && g_str_has_prefix(holder, "mesorigd ");
        device_error_set(
            error, DEVICE_ERROR_BUSY, NULL, "cannot open %s: %s uses it" ERROR_ADVICE "%s", path,
            holder ? holder : "another program",
            daemon ? "use that daemon instead (commands find it by --address or --bus), or end it"
                   : "end that program");
    } else {
        device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                         "cannot open %s: %s" ERROR_ADVICE
                         "check its name, its cable and who may use it",
                         path, g_strerror(why));
    }
    return -1;
}
