#include "serial.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
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

/* Parses a line of /proc/locks: "1: FLOCK  ADVISORY  WRITE 708 00:17:3 0 EOF". The device is in
 * hexadecimal and the inode in decimal digits (proc(5)). */
static int holder_of(const char *line, const struct stat *file) {
    unsigned int major_number, minor_number;
    unsigned long long inode;
    int pid;
    return sscanf(line, "%*d: FLOCK %*s %*s %d %x:%x:%llu", &pid, &major_number, &minor_number,
                  &inode) == 4 &&
                   major_number == major(file->st_dev) && minor_number == minor(file->st_dev) &&
                   inode == file->st_ino
               ? pid
               : 0;
}

char *modbus_serial_holder(const char *path) {
    g_autofree char *locks = NULL;
    struct stat file;
    int pid = 0;
    if (stat(path, &file) != 0 || !g_file_get_contents("/proc/locks", &locks, NULL, NULL))
        return NULL;
    g_auto(GStrv) lines = g_strsplit(locks, "\n", -1);
    for (char **line = lines; *line && pid <= 0; line++)
        pid = holder_of(*line, &file);
    g_autofree char *of = g_strdup_printf("/proc/%d/comm", pid);
    g_autofree char *name = NULL;
    if (pid <= 0 || !g_file_get_contents(of, &name, NULL, NULL))
        return NULL;
    return g_strdup_printf("%s (process %d)", g_strstrip(name), pid);
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
