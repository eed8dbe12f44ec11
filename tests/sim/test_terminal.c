/* The pseudo-terminal of a virtual device: a port that is unplugged hangs up, and its number stays
 * taken. */
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "virtual/terminal.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <sys/stat.h>
#include <unistd.h>

#define N_OTHERS 8

/* A driver has the port open. Returns whether another terminal that is opened after the driver has
 * closed the port has the same node. */
static gboolean is_given_away(struct terminal *terminal, const char *port) {
    struct stat node, other;
    int wires[N_OTHERS], slaves[N_OTHERS];
    gboolean same = FALSE;
    const int driver = open(port, O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(fstat(driver, &node), ==, 0);
    terminal_unplug(terminal);
    struct pollfd at = {.fd = driver, .events = POLLIN};
    g_assert_cmpint(poll(&at, 1, 0), ==, 1);
    g_assert_cmpint(at.revents & POLLHUP, !=, 0);
    close(driver);
    for (int i = 0; i < N_OTHERS; i++) {
        g_assert_cmpint(openpty(&wires[i], &slaves[i], NULL, NULL, NULL), ==, 0);
        g_assert_cmpint(fstat(slaves[i], &other), ==, 0);
        same |= other.st_dev == node.st_dev && other.st_ino == node.st_ino;
    }
    for (int i = 0; i < N_OTHERS; i++) {
        close(wires[i]);
        close(slaves[i]);
    }
    return same;
}

static void check(gboolean reports_opening) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *port = g_build_filename(folder, "port", NULL);
    struct terminal terminal = TERMINAL_CLOSED;
    for (int i = 0; i < 2; i++) {
        g_assert_true(terminal_open(&terminal, port, reports_opening));
        g_assert_false(is_given_away(&terminal, port));
        g_assert_cmpint(terminal.wire, ==, -1);
        g_assert_cmpint(access(port, F_OK), !=, 0);
    }
    terminal_close(&terminal);
    g_assert_cmpint(terminal.kept, ==, -1);
}

TEST(unplugged) {
    check(FALSE);
}

TEST(unplugged__reports_opening) {
    check(TRUE);
}
