#include "serial.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <termios.h>
#include <unistd.h>

int modbus_serial_take(const char *path) {
    int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || flock(fd, LOCK_EX | LOCK_NB) == 0)
        return fd;
    int why = errno;
    close(fd);
    errno = why;
    return -1;
}

void modbus_serial_unsettle(int fd) {
    struct termios settings;
    if (tcgetattr(fd, &settings) < 0)
        return;
    speed_t other = cfgetospeed(&settings) == B9600 ? B19200 : B9600;
    cfsetispeed(&settings, other);
    cfsetospeed(&settings, other);
    settings.c_cflag &= ~(tcflag_t)PARENB;
    tcsetattr(fd, TCSANOW, &settings);
}
