/* Runs mesorig-gphoto2 --list, with a deadline: the library may wait for ever. */
#include "gphoto2.h"

#include "base/program.h"

#include <gio/gio.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/wait.h>
#include <unistd.h>

#define LIST_US (5 * G_USEC_PER_SEC)

/* Returns the device of another scan with this address, or a new one. */
static struct found *find_or_add(GPtrArray *to, const char *place, const char *model,
                                 const char *serial) {
    for (guint i = 0; i < to->len; i++) {
        struct found *found = to->pdata[i];
        if (g_str_equal(found->bus, "usb") && g_str_equal(found->address, place))
            return found;
    }
    return found_add(to, "usb", place, model, serial);
}

static void add_line(GPtrArray *to, const char *line) {
    g_auto(GStrv) parts = g_strsplit(line, "\t", -1);
    int bus, device;
    if (g_strv_length(parts) != 4 || sscanf(parts[3], "usb:%d,%d", &bus, &device) != 2)
        return;
    struct found *found = find_or_add(to, parts[0], parts[1], parts[2]);
    if (found->section)
        return;
    found->section =
        g_strdup_printf("[camera NAME]\ndriver = %s\nport = %s\niso = 100\naperture = 8\n",
                        gphoto2_camera_driver.info.name, parts[0]);
    g_autofree char *node = g_strdup_printf("/dev/bus/usb/%03d/%03d", bus, device);
    if (access(node, R_OK | W_OK) < 0)
        found->note = g_strdup("this user may not open it; add the user to the group plugdev");
}

/* Reads the output of a program until the end of the output or until the deadline, and kills the
 * program if it still runs then. *ret_status is the status of the program as waitpid() gives it.
 * Returns FALSE if the output had not ended at the deadline. */
static gboolean read_output(GPid pid, int fd, GString *to, int *ret_status) {
    const gint64 limit_us = g_get_monotonic_time() + LIST_US;
    char bytes[4096];
    gssize n = 1;
    while (n > 0) {
        const gint64 left_us = limit_us - g_get_monotonic_time();
        struct pollfd ready = {fd, POLLIN, 0};
        n = left_us > 0 && poll(&ready, 1, (int)(left_us / 1000) + 1) > 0
                ? read(fd, bytes, sizeof bytes)
                : -1;
        g_string_append_len(to, bytes, MAX(n, 0));
    }
    close(fd);
    /* The program ends right after its output. */
    struct pollfd ends = {pidfd_open(pid, 0), POLLIN, 0};
    if (n == 0 && ends.fd >= 0)
        poll(&ends, 1, (int)(MAX(limit_us - g_get_monotonic_time(), 0) / 1000));
    if (ends.fd >= 0)
        close(ends.fd);
    kill(pid, SIGKILL);
    *ret_status = 0;
    waitpid(pid, ret_status, 0);
    return n == 0;
}

gboolean gphoto2_scan(GPtrArray *to, GError **error) {
    g_autofree char *program = program_find("mesorig-gphoto2", error);
    const char *const argv[] = {program, "--list", NULL};
    g_autoptr(GString) text = g_string_new(NULL);
    GPid pid;
    int out, status;
    if (!program || !g_spawn_async_with_pipes_and_fds(
                        NULL, argv, NULL, G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_STDERR_TO_DEV_NULL,
                        NULL, NULL, -1, -1, -1, NULL, NULL, 0, &pid, NULL, &out, NULL, error))
        return FALSE;
    if (!read_output(pid, out, text, &status)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                    "libgphoto2 did not list the still cameras within %d s; unplug the USB device "
                    "that was connected last, then try again",
                    (int)(LIST_US / G_USEC_PER_SEC));
        return FALSE;
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "libgphoto2 could not list the still cameras: “%s --list” tells why", program);
        return FALSE;
    }
    g_auto(GStrv) lines = g_strsplit(text->str, "\n", -1);
    for (char **line = lines; *line; line++)
        add_line(to, *line);
    return TRUE;
}
