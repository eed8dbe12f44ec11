#include "terminal.h"

#include <fcntl.h>
#include <glib/gstdio.h>
#include <pty.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

static void close_one(int *fd) {
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

gboolean terminal_open(struct terminal *terminal, const char *link, gboolean reports_opening) {
    struct termios raw = {0};
    char name[64];
    cfmakeraw(&raw);
    raw.c_cflag |= CS8 | CREAD | CLOCAL;
    close_one(&terminal->wire);
    close_one(&terminal->slave);
    if (openpty(&terminal->wire, &terminal->slave, name, &raw, NULL) != 0)
        return FALSE;
    fcntl(terminal->wire, F_SETFL, O_NONBLOCK);
    fcntl(terminal->wire, F_SETFD, FD_CLOEXEC);
    fcntl(terminal->slave, F_SETFD, FD_CLOEXEC);
    if (reports_opening)
        close_one(&terminal->slave);
    g_unlink(link);
    return symlink(name, link) == 0;
}

void terminal_unplug(struct terminal *terminal) {
    char name[64];
    if (terminal->wire < 0)
        return;
    close_one(&terminal->kept);
    if (terminal->slave < 0 && ptsname_r(terminal->wire, name, sizeof name) == 0)
        terminal->slave = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    terminal->kept = terminal->slave;
    terminal->slave = -1;
    close_one(&terminal->wire);
}

void terminal_close(struct terminal *terminal) {
    close_one(&terminal->wire);
    close_one(&terminal->slave);
    close_one(&terminal->kept);
}
