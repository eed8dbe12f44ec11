#include "scan.h"

#include "address.h"
#include "line.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CONNECT_US (3 * G_USEC_PER_SEC)

/* Returns the product name of the USB adapter behind a serial port, or "serial port" if it is
 * not on USB. */
static char *port_name(const char *tty) {
    g_autofree char *device = g_build_filename("/sys/class/tty", tty, "device", NULL);
    char *folder = realpath(device, NULL);
    g_autofree char *at = g_strdup(folder ? folder : "");
    free(folder);
    while (strlen(at) > 1) {
        g_autofree char *file = g_build_filename(at, "product", NULL);
        g_autofree char *product = NULL;
        if (g_file_get_contents(file, &product, NULL, NULL))
            return g_strdup(g_strstrip(product));
        char *up = g_path_get_dirname(at);
        g_free(at);
        at = up;
    }
    return g_strdup("serial port");
}

static int scan_by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

gboolean serial_scan(GPtrArray *to, GError **error) {
    g_autoptr(GDir) dir = g_dir_open("/sys/class/tty", 0, NULL);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *file = g_build_filename("/sys/class/tty", name, "type", NULL);
        g_autofree char *type = NULL;
        /* A port of the mainboard that does not exist has type 0. */
        if (g_str_has_prefix(name, "ttyUSB") || g_str_has_prefix(name, "ttyACM") ||
            (g_str_has_prefix(name, "ttyS") && g_file_get_contents(file, &type, NULL, NULL) &&
             atoi(type) != 0))
            g_ptr_array_add(names, g_strdup(name));
    }
    g_ptr_array_sort(names, scan_by_name);
    for (guint i = 0; i < names->len; i++) {
        g_autofree char *path = g_strconcat("/dev/", names->pdata[i], NULL);
        g_autofree char *what = port_name(names->pdata[i]);
        struct found *found = found_add(to, "serial", path, what, NULL);
        found->note =
            access(path, R_OK | W_OK) < 0
                ? g_strdup_printf("this user may not open it: join the group that “ls -l %s” "
                                  "shows, often dialout",
                                  path)
                : g_strdup_printf("for Modbus (“mesorig devices --modbus %s” searches for "
                                  "devices), for a G-code board (gcode-axis), or for an LED "
                                  "controller (serial-lamps)",
                                  path);
    }
    return TRUE;
}

enum presence { ABSENT, REFUSES, ANSWERS };

/* Returns ABSENT if no answer came. An exception or a damaged answer also proves that the unit
 * is present. */
static enum presence scan_ask(struct modbus_line *line, const struct modbus_link *link, int unit,
                              enum modbus_kind kind, int n) {
    struct modbus_request request = {.kind = kind, .n = n};
    g_autoptr(GError) error = NULL;
    gint64 deadline =
        g_get_monotonic_time() + (gint64)((2 * link->timeout_ms + 3 * link->late_ms) * 1000);
    if (modbus_line_do(line, unit, &request, deadline, &error))
        return ANSWERS;
    return g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT) ||
                   g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED)
               ? ABSENT
               : REFUSES;
}

static void add_unit(const struct modbus_link *link, int unit, gboolean registers, int coils,
                     GPtrArray *to) {
    g_autofree char *address = g_strdup_printf("%s, unit %d", link->bus, unit);
    g_autofree char *bits = g_strdup_printf("%d coils", coils);
    g_autofree char *what =
        registers || coils ? g_strdup_printf("answers to %s%s%s", registers ? "registers" : "",
                                             registers && coils ? " and " : "", coils ? bits : "")
                           : g_strdup("answers, but its first register and coil cannot be read");
    struct found *found = found_add(to, "modbus", address, what, NULL);
    g_autoptr(GString) section = g_string_new(NULL);
    /* A unit with coils is taken as a relay board, even if it has registers: relay boards have
     * registers for their settings, and most drives have no coils. */
    const gboolean relays = coils > 0;
    g_string_append(section, relays ? "[lamps NAME]\ndriver = modbus-relays\n"
                                    : "[axis NAME]\ndriver = modbus-axis\n");
    g_string_append_printf(section, "bus = %s\n", link->bus);
    if (!g_str_has_prefix(link->bus, "tcp:"))
        g_string_append_printf(section, "baud = %d\nparity = %s\nstop_bits = %d\n", link->baud,
                               modbus_parities[link->parity], link->stop_bits);
    g_string_append_printf(section, "unit = %d\n", unit);
    if (relays) {
        g_string_append_printf(section, "n = %d\n", coils);
        if (registers)
            g_string_append(section, "# or, if it is a drive with coils:\n"
                                     "# [axis NAME]\n# driver = modbus-axis\n");
    } else
        g_string_append(section,
                        "# and its registers, from its manual or a preset of etc/devices\n");
    found->section = g_strdup(section->str);
    pid_t pid;
    if (modbus_is_tcp(link->bus) && modbus_address_unit_holder(link->bus, unit, &pid)) {
        g_autofree char *holder = lock_process(pid);
        found->note = g_strdup_printf("%s uses it", holder);
    }
}

gboolean modbus_scan(const struct modbus_link *link, int first, int last, GPtrArray *to,
                     GError **error) {
    struct modbus_line *line = modbus_line_new(link, error);
    if (!line)
        return FALSE;
    gboolean ok = modbus_line_connect(line, g_get_monotonic_time() + CONNECT_US, error);
    for (int unit = first; ok && unit <= last; unit++) {
        enum presence registers = scan_ask(line, link, unit, MODBUS_READ_HOLDING, 1);
        /* The largest number of coils, 32, 16, 8, …, that the unit reads in one request; 0 if
         * none. */
        int coils = registers == ABSENT ? 0 : 32;
        while (coils > 0 && scan_ask(line, link, unit, MODBUS_READ_COILS, coils) != ANSWERS)
            coils /= 2;
        if (registers != ABSENT)
            add_unit(link, unit, registers == ANSWERS, coils, to);
    }
    modbus_line_free(line);
    return ok;
}
