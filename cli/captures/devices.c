/* devices: lists the devices on the buses, and the rig file sections that would use them. */
#include "captures.h"
#include "common/cli.h"
#include "rig/finder.h"

#include <string.h>

#define MAX_UNIT 247

static char *modbus_option, *parity_option, *units_option;
static int baud_option;

static const GOptionEntry entries[] = {
    {"modbus", 0, 0, G_OPTION_ARG_STRING, &modbus_option,
     "Also look for units on this Modbus line: /dev/ttyUSB0, or tcp:HOST:PORT", "LINE"},
    {"units", 0, 0, G_OPTION_ARG_STRING, &units_option,
     "With --modbus: addresses of the units to ask (1-16)", "FIRST-LAST"},
    {"baud", 0, 0, G_OPTION_ARG_INT, &baud_option, "With --modbus: speed of the line (115200)",
     "BAUD"},
    {"parity", 0, 0, G_OPTION_ARG_STRING, &parity_option,
     "With --modbus: parity of the line (even)", "none|even|odd"},
    {NULL},
};

static const struct {
    const char *bus, *title;
} buses[] = {
    {"usb", "USB"},
    {"video", "Video (V4L2)"},
    {"gige", "GigE Vision"},
    {"usb3-vision", "USB3 Vision"},
    {"serial", "Serial ports"},
    {"modbus", "Modbus"},
};

static void say_one(Record *to, const struct found *found) {
    record_say(to, "  %s  %s%s%s%s\n", found->address, found->what,
               *found->serial ? " (serial " : "", found->serial, *found->serial ? ")" : "");
    if (found->note)
        record_say(to, "    %s\n", found->note);
    g_auto(GStrv) lines = g_strsplit(found->section ? found->section : "", "\n", -1);
    for (int i = 0; lines[i]; i++)
        if (*lines[i])
            record_say(to, "      %s\n", lines[i]);
    if (found->section)
        record_say(to, "\n");
}

/* Prints the devices of each bus, and finally one line about devices without a driver. */
static void say_all(Record *to, const GPtrArray *all) {
    g_autoptr(GString) others = g_string_new(NULL);
    int n = 0;
    for (gsize b = 0; b < G_N_ELEMENTS(buses); b++) {
        const char *title = buses[b].title;
        for (guint i = 0; i < all->len; i++) {
            const struct found *found = all->pdata[i];
            if (strcmp(found->bus, buses[b].bus) != 0 || (!found->section && !found->note))
                continue;
            if (title)
                record_say(to, "%s\n", title);
            title = NULL;
            say_one(to, found);
            n++;
        }
    }
    if (n == 0)
        record_say(to, "No supported device was found on USB, video, network and serial ports.\n");
    else
        record_say(to, "Give each section a NAME. “mesorig drivers camera” (or laser) lists the "
                       "further keys, such as its position.\n");
    for (guint i = 0; i < all->len; i++) {
        const struct found *found = all->pdata[i];
        if (!found->section && !found->note)
            g_string_append_printf(others, "%s%s (%s)", others->len ? ", " : "", found->what,
                                   found->address);
    }
    if (others->len)
        record_say(to, "No driver supports: %s\n", others->str);
}

static void tell_all(Record *to, const GPtrArray *all, const GPtrArray *problems) {
    record_begin_list(to, "devices");
    for (guint i = 0; i < all->len; i++) {
        const struct found *found = all->pdata[i];
        const char *const texts[][2] = {{"bus", found->bus},         {"address", found->address},
                                        {"what", found->what},       {"serial", found->serial},
                                        {"section", found->section}, {"note", found->note}};
        record_begin(to, NULL);
        for (gsize k = 0; k < G_N_ELEMENTS(texts); k++)
            if (texts[k][1] && *texts[k][1])
                record_string(to, texts[k][0], texts[k][1]);
        record_end(to);
    }
    record_end(to);
    record_strings(to, "problems", problems);
    say_all(to, all);
    for (guint i = 0; i < problems->len && !cli_json; i++)
        g_printerr("mesorig: %s\n", (char *)problems->pdata[i]);
}

/* Parses the address of one unit, such as "5", or a range, such as "1-16". Returns FALSE for other
 * texts, and for addresses outside 1 … MAX_UNIT. */
static gboolean parse_units(const char *text, struct finder_modbus *modbus) {
    g_auto(GStrv) parts = g_strsplit(text, "-", 2);
    gint64 first, last;
    if (!g_ascii_string_to_signed(parts[0] ? parts[0] : "", 10, 1, MAX_UNIT, &first, NULL) ||
        !g_ascii_string_to_signed(parts[0] && parts[1] ? parts[1] : parts[0], 10, first, MAX_UNIT,
                                  &last, NULL))
        return FALSE;
    modbus->first = (int)first;
    modbus->last = (int)last;
    return TRUE;
}

static int run_devices(const struct call *call, GError **error) {
    const struct command *command = call->command;
    struct finder_modbus modbus = {.first = 1, .last = 16};
    if (units_option && !parse_units(units_option, &modbus))
        return cli_usage(command,
                         "--units=%s: give an address from 1 to 247, or a range such as 1-16",
                         units_option);
    if (baud_option < 0)
        return cli_usage(command, "--baud=%d: give a speed above 0, such as 115200", baud_option);
    if (!modbus_option && (units_option || baud_option || parity_option))
        return cli_usage(command, "--units, --baud and --parity describe the line of --modbus: "
                                  "give --modbus LINE as well");
    modbus.bus = modbus_option;
    modbus.baud = baud_option;
    modbus.parity = parity_option;
    g_autoptr(GError) bad = NULL;
    g_autoptr(GPtrArray) problems = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GPtrArray) all = finder_scan(&modbus, problems, &bad);
    if (!all)
        return cli_usage(command, "%s", bad->message);
    tell_all(call->record, all, problems);
    return problems->len ? CLI_FAILED : CLI_DONE;
}

const struct command cli_devices = {
    .name = "devices",
    .arguments = "",
    .examples = "  mesorig devices\n"
                "  mesorig devices --json | jq .\n",
    .help = "List the devices on the buses, with sections for a rig file.",
    .options = entries,
    .run = run_devices};
