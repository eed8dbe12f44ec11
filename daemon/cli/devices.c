/* devices: what is on the buses, and which section of a rig file would use it. */
#include "cli.h"
#include "rig/finder.h"

#include <string.h>

#define MAX_UNIT 247

static char *modbus_option, *parity_option, *units_option;
static int baud_option;

static const GOptionEntry entries[] = {
    {"modbus", 0, 0, G_OPTION_ARG_STRING, &modbus_option,
     "Also ask which units are on a Modbus line: /dev/ttyUSB0, or tcp:HOST:PORT", "LINE"},
    {"units", 0, 0, G_OPTION_ARG_STRING, &units_option, "Which units to ask (1-16)", "FIRST-LAST"},
    {"baud", 0, 0, G_OPTION_ARG_INT, &baud_option, "The line's speed (115200)", "BAUD"},
    {"parity", 0, 0, G_OPTION_ARG_STRING, &parity_option, "none, even or odd (even)", "PARITY"},
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

static void print_section(const char *section) {
    g_auto(GStrv) lines = g_strsplit(section, "\n", -1);
    for (int i = 0; lines[i]; i++)
        if (*lines[i])
            g_print("      %s\n", lines[i]);
    g_print("\n");
}

static void print_one(const struct found *found) {
    g_print("  %s  %s%s%s%s\n", found->address, found->what, *found->serial ? " (serial " : "",
            found->serial, *found->serial ? ")" : "");
    if (found->note)
        g_print("    %s\n", found->note);
    if (found->section)
        print_section(found->section);
}

/* What no driver is for is told at the end, in a line. */
static void print_others(const GPtrArray *all) {
    g_autoptr(GString) others = g_string_new(NULL);
    for (guint i = 0; i < all->len; i++) {
        const struct found *found = all->pdata[i];
        if (!found->section && !found->note)
            g_string_append_printf(others, "%s%s (%s)", others->len ? ", " : "", found->what,
                                   found->address);
    }
    if (others->len)
        g_print("No driver is for: %s\n", others->str);
}

static int print_bus(const GPtrArray *all, const char *bus, const char *title) {
    int n = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct found *found = all->pdata[i];
        if (strcmp(found->bus, bus) != 0 || (!found->section && !found->note))
            continue;
        if (n++ == 0)
            g_print("%s\n", title);
        print_one(found);
    }
    return n;
}

static void print_all(const GPtrArray *all, const GPtrArray *problems) {
    int n = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(buses); i++)
        n += print_bus(all, buses[i].bus, buses[i].title);
    if (n == 0)
        g_print(
            "Nothing that a driver is for was found on USB, video, network and serial ports.\n");
    else
        g_print("Give each a NAME. “mesorig drivers camera”, or laser, tells what a section says "
                "beside, of where it stands.\n");
    print_others(all);
    for (guint i = 0; i < problems->len; i++)
        g_printerr("mesorig: %s\n", (char *)problems->pdata[i]);
}

static void add_text(GVariantBuilder *to, const char *key, const char *text) {
    if (text && *text)
        g_variant_builder_add(to, "{sv}", key, g_variant_new_string(text));
}

static GVariant *one_json(const struct found *found) {
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    add_text(&builder, "bus", found->bus);
    add_text(&builder, "address", found->address);
    add_text(&builder, "what", found->what);
    add_text(&builder, "serial", found->serial);
    add_text(&builder, "section", found->section);
    add_text(&builder, "note", found->note);
    return g_variant_builder_end(&builder);
}

static void cli_devices_print_json(const GPtrArray *all, const GPtrArray *problems) {
    GVariantBuilder builder, list;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < all->len; i++)
        g_variant_builder_add_value(&list, one_json(all->pdata[i]));
    g_variant_builder_add(&builder, "{sv}", "devices", g_variant_builder_end(&list));
    g_variant_builder_add(
        &builder, "{sv}", "problems",
        g_variant_new_strv((const char *const *)problems->pdata, (gssize)problems->len));
    cli_print_json(g_variant_builder_end(&builder));
}

/* "5", or "1-16". */
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

static int run_devices(const struct command *command, int argc, char **argv) {
    struct finder_modbus modbus = {.first = 1, .last = 16};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 0, 0))
        return CLI_USAGE;
    if (units_option && !parse_units(units_option, &modbus))
        return cli_usage(command, "“%s” are no units; say one of 1 to 247, or a range as 1-16",
                         units_option);
    if (baud_option < 0 || (!modbus_option && (units_option || baud_option || parity_option)))
        return cli_usage(command, "--units, --baud and --parity are about the line of --modbus");
    modbus.bus = modbus_option;
    modbus.baud = baud_option;
    modbus.parity = parity_option;
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) problems = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GPtrArray) all = finder_scan(&modbus, problems, &error);
    if (!all)
        return cli_usage(command, "%s", error->message);
    if (cli_json)
        cli_devices_print_json(all, problems);
    else
        print_all(all, problems);
    return problems->len ? CLI_FAILED : CLI_DONE;
}

const struct command cli_devices = {
    .name = "devices",
    .arguments = "",
    .help = "List what is on the buses, and the sections that would use it.",
    .run_arguments = run_devices};
