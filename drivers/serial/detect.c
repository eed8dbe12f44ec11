#include "detect.h"

#include "port.h"

#include <poll.h>
#include <string.h>
#include <unistd.h>

#define ASK_MS    500  /* time between two questions while the board boots */
#define LISTEN_MS 3500 /* at each speed, time that the board has to boot and to answer */
#define MAX_LINE  512

struct found {
    enum gcode_dialect dialect;
    char *firmware;
    gboolean is_other; /* firmware speaks a language that has no driver */
};

/* Takes the name of a firmware. grblHAL with a plug-in answers M115 like Marlin, as do firmwares of
 * other languages. */
static struct found named(const char *name) {
    const gboolean grbl = g_ascii_strncasecmp(name, "grbl", 4) == 0;
    const char *end = strstr(name, " FIRMWARE_");
    return (struct found){grbl ? GCODE_GRBL : GCODE_MARLIN,
                          g_strndup(name, end ? (gsize)(end - name) : strlen(name)),
                          !grbl && g_ascii_strncasecmp(name, "marlin", 6) != 0};
}

/* Takes a line of the board. Returns whether it shows the language. */
static gboolean take_line(const char *line, struct found *ret) {
    struct gcode_answer answer;
    gcode_klipper_read(line, &answer);
    if (answer.kind == GCODE_OK && *answer.text) {
        *ret = (struct found){GCODE_KLIPPER, g_strdup(answer.text), FALSE};
        return TRUE;
    }
    gcode_marlin_read(line, &answer);
    if (answer.kind == GCODE_VERSION) {
        *ret = named(answer.text);
        return TRUE;
    }
    gcode_grbl_read(line, &answer);
    if (answer.kind == GCODE_ERROR || answer.kind == GCODE_BANNER) {
        *ret = (struct found){GCODE_GRBL, g_strdup("GRBL"), FALSE};
        return TRUE;
    }
    return FALSE;
}

/* Takes all complete lines of the input. */
static gboolean take_lines(GString *input, struct found *ret) {
    for (char *end; (end = strpbrk(input->str, "\r\n"));) {
        *end = 0;
        g_autofree char *line = g_strdup(input->str);
        g_string_erase(input, 0, (gssize)strlen(line) + 1);
        if (take_line(g_strstrip(line), ret))
            return TRUE;
    }
    if (input->len > MAX_LINE)
        g_string_truncate(input, 0);
    return FALSE;
}

/* Asks until the board has answered or the time is over. */
static gboolean ask(int fd, struct found *ret) {
    const gint64 until = g_get_monotonic_time() + LISTEN_MS * (gint64)1000;
    g_autoptr(GString) input = g_string_new(NULL);
    gint64 asked = 0;
    for (gint64 now; (now = g_get_monotonic_time()) < until;) {
        char bytes[256];
        struct pollfd poller = {.fd = fd, .events = POLLIN};
        if (now > asked + ASK_MS * 1000) {
            asked = now;
            if (write(fd, "\nM115\n", 6) < 0)
                return FALSE;
        }
        const gssize n = poll(&poller, 1, 50) > 0 ? read(fd, bytes, sizeof bytes) : 0;
        for (gssize i = 0; i < n; i++)
            g_string_append_c(input, bytes[i] ? bytes[i] : '?');
        if (take_lines(input, ret))
            return TRUE;
        if (poller.revents & POLLHUP)
            return FALSE;
    }
    return FALSE;
}

gboolean gcode_detect(const char *port, enum gcode_dialect *ret_dialect, int *ret_baud,
                      char **ret_firmware, GError **error) {
    static const int bauds[] = {115200, 250000};
    for (gsize i = 0; i < G_N_ELEMENTS(bauds); i++) {
        struct found found;
        const int fd = serial_port_open(port, bauds[i], error);
        if (fd < 0)
            return FALSE;
        const gboolean answered = ask(fd, &found);
        close(fd);
        if (!answered)
            continue;
        if (found.is_other) {
            device_error_set(error, DEVICE_ERROR_UNSUPPORTED, NULL,
                             "%s: the firmware of the board is %s" ERROR_ADVICE
                             "use GRBL, FluidNC, grblHAL, Marlin or Klipper",
                             port, found.firmware);
            g_free(found.firmware);
            return FALSE;
        }
        *ret_dialect = found.dialect;
        *ret_baud = bauds[i];
        *ret_firmware = found.firmware;
        return TRUE;
    }
    return device_error_set(error, DEVICE_ERROR_TIMEOUT, NULL,
                            "%s: no board with GRBL, Marlin or Klipper answers at %d or %d "
                            "baud" ERROR_ADVICE "check the power of the board and the cable",
                            port, bauds[0], bauds[1]);
}
