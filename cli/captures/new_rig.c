/* new-rig: writes a first rig file for the devices that are plugged in. */
#include "captures.h"
#include "common/cli.h"
#include "new_rig_text.h"
#include "rig/devices.h"
#include "rig/finder.h"
#include "rig/lamp_places.h"

#include <gio/gio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define MAX_ID 60 /* maximum length of the rig's name in bytes */

static char *kind_option, *lamps_option, *radius_option, *axes_option, *bank_option,
    *cameras_option;
static gboolean offline;

static const GOptionEntry entries[] = {
    {"kind", 0, 0, G_OPTION_ARG_STRING, &kind_option,
     "Kind of rig: lamps in a dome, a turntable under fixed lamps, or a turntable under an arc "
     "that "
     "carries the lamps",
     "dome|turntable|arc"},
    {"lamps", 0, 0, G_OPTION_ARG_STRING, &lamps_option,
     "Number of lamps, or a file with their positions: a list (.lp) or a table", "N|FILE"},
    {"radius", 0, 0, G_OPTION_ARG_STRING, &radius_option, "Distance of the lamps from the sample",
     "MM"},
    {"axes", 0, 0, G_OPTION_ARG_STRING, &axes_option,
     "What moves the axes, and its port or path: tic, gcode:PORT or program:PATH", "WAY"},
    {"bank", 0, 0, G_OPTION_ARG_STRING, &bank_option,
     "What switches the lamps, and its port, address or path: relays, serial:PORT, artnet:ADDRESS, "
     "sacn:ADDRESS, sacn:multicast, wled:ADDRESS or program:PATH",
     "WAY"},
    {"cameras", 0, 0, G_OPTION_ARG_STRING, &cameras_option,
     "What takes the pictures: found (the cameras that are plugged in), still:PORT or program:PATH",
     "WAY"},
    {"offline", 0, 0, G_OPTION_ARG_NONE, &offline,
     "Look for no devices: the rig file is for another computer", NULL},
    {NULL},
};

/* Reads an answer and stores it in rig. Returns NULL, or a text that says what is wrong with the
 * answer, to be freed with g_free(). */
typedef char *(*Take)(const char *text, struct new_rig *rig);

static char *take_kind(const char *text, struct new_rig *rig) {
    for (int i = 0; i < NEW_RIG_KINDS; i++)
        if (g_str_equal(new_rig_kinds[i], text)) {
            rig->kind = i;
            return NULL;
        }
    return g_strdup_printf("there is no kind of rig “%s”; choose from: dome, turntable, arc", text);
}

/* Returns NULL if the bank has enough lamps. Otherwise returns the message, to be freed with
 * g_free(). */
static char *check_bank(const struct new_rig *rig) {
    const struct new_rig_way *bank = &new_rig_banks[rig->bank];
    if (rig->n_lamps <= bank->max_lamps)
        return NULL;
    return g_strdup_printf("“%s” has at most %d lamps, not %d. Choose another bank, or give fewer "
                           "lamps and add the others to the rig file, in a further section "
                           "[lamps NAME]",
                           bank->name, bank->max_lamps, rig->n_lamps);
}

/* Reads the positions of the lamps from a file. If the file has only directions, rig->far is set to
 * TRUE. Returns NULL, or what is wrong with the file, to be freed with g_free(). */
static char *take_positions(const char *path, struct new_rig *rig) {
    struct lamp_place otherwise = {.exponent = 1, .intensity = 1};
    g_autoptr(GError) error = NULL;
    g_autoptr(GArray) lamps = lamp_places_read(path, &otherwise, NULL);
    rig->far = !lamps;
    if (rig->far) {
        otherwise.distance_mm = NEW_RIG_MIN_RADIUS_MM;
        lamps = lamp_places_read(path, &otherwise, &error);
    }
    if (!lamps)
        return g_strdup(error->message);
    rig->positions = g_intern_string(path);
    rig->n_lamps = (int)lamps->len;
    for (guint i = 0; i < lamps->len && !rig->far; i++)
        rig->radius_mm += g_array_index(lamps, struct lamp_place, i).distance_mm / lamps->len;
    return NULL;
}

static char *take_lamps(const char *text, struct new_rig *rig) {
    gint64 n;
    if (g_ascii_string_to_signed(text, 10, 1, RIG_MAX_LAMPS, &n, NULL)) {
        rig->n_lamps = (int)n;
    } else if (g_file_test(text, G_FILE_TEST_EXISTS)) {
        char *wrong = take_positions(text, rig);
        if (wrong)
            return wrong;
    } else {
        return g_strdup_printf(
            "“%s” is not a number of lamps from 1 to %d, and there is no file of "
            "this name",
            text, RIG_MAX_LAMPS);
    }
    return bank_option ? check_bank(rig) : NULL; /* otherwise take_bank() checks it */
}

static char *take_radius(const char *text, struct new_rig *rig) {
    char *end;
    const double mm = g_ascii_strtod(text, &end);
    if (end == text || *end || !(mm >= NEW_RIG_MIN_RADIUS_MM && mm <= NEW_RIG_MAX_RADIUS_MM))
        return g_strdup_printf("“%s” is not a radius from %g to %g mm", text, NEW_RIG_MIN_RADIUS_MM,
                               NEW_RIG_MAX_RADIUS_MM);
    rig->radius_mm = mm;
    return NULL;
}

/* Returns a list of names: “tic, gcode or program”. Free it with g_free(). */
static char *names_of(const struct new_rig_way *ways) {
    GString *text = g_string_new(ways[0].name);
    for (int i = 1; ways[i].name; i++)
        g_string_append_printf(text, "%s%s", ways[i + 1].name ? ", " : " or ", ways[i].name);
    return g_string_free(text, FALSE);
}

/* Reads “NAME” or “NAME:PLACE”, where NAME is one of `ways`. *ret_place becomes NULL without a
 * place. Returns NULL, or what is wrong with the text, to be freed with g_free(). */
static char *take_way(const char *text, const struct new_rig_way *ways, int *ret,
                      const char **ret_place) {
    const char *colon = strchr(text, ':');
    const gsize n = colon ? (gsize)(colon - text) : strlen(text);
    g_autofree char *names = names_of(ways);
    for (int i = 0; ways[i].name; i++) {
        if (strncmp(ways[i].name, text, n) != 0 || ways[i].name[n])
            continue;
        if (colon && !ways[i].question)
            return g_strdup_printf("“%s” has no port, address or path: leave out “:” and the rest",
                                   ways[i].name);
        *ret = i;
        *ret_place = colon && colon[1] ? g_intern_string(colon + 1) : NULL;
        return NULL;
    }
    return g_strdup_printf("there is no “%.*s”; choose from: %s", (int)n, text, names);
}

static char *take_axes(const char *text, struct new_rig *rig) {
    int i = 0;
    char *wrong = take_way(text, new_rig_axes, &i, &rig->axes_at);
    rig->axes = (enum new_rig_axes)i;
    return wrong;
}

static char *take_bank(const char *text, struct new_rig *rig) {
    int i = 0;
    char *wrong = take_way(text, new_rig_banks, &i, &rig->bank_at);
    rig->bank = (enum new_rig_bank)i;
    return wrong ? wrong : check_bank(rig);
}

static char *take_cameras(const char *text, struct new_rig *rig) {
    int i = 0;
    char *wrong = take_way(text, new_rig_cameras, &i, &rig->camera_at);
    rig->camera = (enum new_rig_camera)i;
    return wrong;
}

static char *take_axes_at(const char *text, struct new_rig *rig) {
    rig->axes_at = g_intern_string(text);
    return NULL;
}

static char *take_bank_at(const char *text, struct new_rig *rig) {
    rig->bank_at = g_intern_string(text);
    return NULL;
}

static char *take_camera_at(const char *text, struct new_rig *rig) {
    rig->camera_at = g_intern_string(text);
    return NULL;
}

/* Asks on the terminal until the answer is valid. An empty answer, or the end of the input, means
 * the default. */
static void ask(const char *question, const char *otherwise, Take take, struct new_rig *rig) {
    for (;;) {
        g_autofree char *wrong = NULL;
        char line[256];
        g_printerr("%s [%s]: ", question, otherwise);
        const char *text = fgets(line, sizeof line, stdin) ? g_strstrip(line) : NULL;
        if (!text)
            g_printerr("\n");
        wrong = take(text && *text ? text : otherwise, rig);
        if (!wrong)
            return;
        g_printerr("%s\n", wrong);
    }
}

/* Asks how axes, lamps and cameras are operated, and where they are connected, as far as the
 * options do not say so. */
static void ask_ways(struct new_rig *rig) {
    const struct {
        const char *given, *question;
        const struct new_rig_way *ways;
        Take take, take_place;
    } asked[] = {
        {axes_option, "What moves the axes", new_rig_axes, take_axes, take_axes_at},
        {bank_option, "What switches the lamps", new_rig_banks, take_bank, take_bank_at},
        {cameras_option, "What takes the pictures", new_rig_cameras, take_cameras, take_camera_at},
    };
    for (gsize i = rig->kind == NEW_RIG_DOME ? 1 : 0; i < G_N_ELEMENTS(asked); i++) {
        g_autofree char *names = names_of(asked[i].ways);
        g_autofree char *question = g_strdup_printf("%s: %s", asked[i].question, names);
        const struct new_rig_way *usual = asked[i].ways;
        while (usual->max_lamps > 0 && usual->max_lamps < rig->n_lamps)
            usual++;
        if (!asked[i].given)
            ask(question, usual->name, asked[i].take, rig);
        const int chosen[] = {(int)rig->axes, (int)rig->bank, (int)rig->camera};
        const char *const places[] = {rig->axes_at, rig->bank_at, rig->camera_at};
        const struct new_rig_way *way = &asked[i].ways[chosen[i]];
        if (way->question && !places[i])
            ask(way->question, way->usual, asked[i].take_place, rig);
    }
    if (rig->bank == NEW_RIG_SACN && g_str_equal(rig->bank_at, "multicast"))
        rig->bank_at = "";
}

/* Asks the G-code board for its language. */
static void ask_board(struct new_rig *rig, GPtrArray *problems) {
    g_autoptr(GError) error = NULL;
    char *firmware;
    if (rig->axes != NEW_RIG_GCODE || rig->kind == NEW_RIG_DOME)
        return;
    rig->dialect = "";
    if (!finder_gcode(rig->axes_at, &rig->dialect, &rig->baud, &firmware, &error)) {
        g_ptr_array_add(problems, g_strdup(error->message));
        return;
    }
    rig->firmware = g_intern_string(firmware);
    g_free(firmware);
}

/* Returns whether a device is to be found among those that are plugged in, because no place is
 * asked for it. */
static gboolean needs_scan(const struct new_rig *rig) {
    return rig->bank == NEW_RIG_RELAYS || rig->camera == NEW_RIG_FOUND ||
           (rig->axes == NEW_RIG_TIC && rig->kind != NEW_RIG_DOME);
}

/* Opens the cameras to learn the size of their pictures. A failure is added to problems. */
static void ask_cameras(struct new_rig *rig, GPtrArray *found, GPtrArray *problems) {
    g_autofree char *asked = new_rig_camera(rig);
    g_autoptr(GError) error = NULL;
    if (asked && !finder_picture_size(asked, &rig->width, &rig->height, &rig->bits, &error))
        g_ptr_array_add(problems, g_strdup(error->message));
    for (guint i = 0; i < found->len && !asked; i++) {
        struct found *device = found->pdata[i];
        g_autoptr(GError) failed = NULL;
        int width, height, bits;
        if (!device->section || !g_str_has_prefix(device->section, "[camera ") ||
            strstr(device->section, "\nwidth = "))
            continue;
        if (finder_picture_size(device->section, &width, &height, &bits, &failed)) {
            g_autofree char *section = device->section;
            device->section =
                g_strdup_printf("%swidth = %d\nheight = %d\n", section, width, height);
        } else {
            g_ptr_array_add(problems, g_strdup(failed->message));
        }
    }
}

/* Makes the path of the positions relative if their file is in the folder of the rig file, and
 * absolute otherwise. */
static void place_positions(struct new_rig *rig, const char *path) {
    if (!rig->positions)
        return;
    g_autofree char *full = g_canonicalize_filename(rig->positions, NULL);
    g_autofree char *file = g_canonicalize_filename(path, NULL);
    g_autofree char *folder = g_path_get_dirname(full), *beside = g_path_get_dirname(file);
    g_autofree char *name = g_path_get_basename(full);
    rig->positions = g_intern_string(g_str_equal(folder, beside) ? name : full);
}

/* Returns the name of the rig, which is the name of the file without its suffix. Free it with
 * g_free(). */
static char *id_of(const char *path) {
    g_autofree char *name = g_path_get_basename(path);
    char *dot = strrchr(name, '.');
    if (dot && dot > name)
        *dot = '\0';
    g_autofree char *id = g_utf8_make_valid(name, -1);
    for (char *c = id; *c; c++)
        if (g_ascii_iscntrl(*c))
            *c = '_';
    if (strlen(id) > MAX_ID)
        *g_utf8_find_prev_char(id, id + MAX_ID) = '\0';
    g_strstrip(id);
    return *id ? g_steal_pointer(&id) : g_strdup("rig");
}

static gboolean write_text(OutputFile *file, const char *text, GError **error) {
    const char *path = output_file_path(file, error);
    return path && output_file_end(file, g_file_set_contents(path, text, -1, error), error);
}

static void tell(Record *to, const char *path, const struct new_rig *rig,
                 const GPtrArray *missing) {
    record_say(to,
               "%s{file}: a rig of the kind %s{kind} with %d{lamps} lamps at %g{radius_mm} mm\n",
               path, new_rig_kinds[rig->kind], rig->n_lamps, rig->radius_mm);
    record_say_strings(to, "missing", "not found: ", missing);
    record_say(to,
               "Correct what stands below CHECK%s in the file. Then check it:\n  mesorig plan "
               "--offline %s SESSION.conf\n",
               missing->len ? " and NOT FOUND" : "", path);
}

static int run(const struct call *call, GError **error) {
    const char *path = call->arguments[0];
    g_autofree char *id = id_of(path), *wrong = NULL;
    struct new_rig rig = {.id = id};
    g_autoptr(GPtrArray) problems = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
    const struct {
        const char *name, *given, *question;
        Take take;
    } asked[] = {
        {"kind", kind_option, "Kind of rig: dome, turntable or arc", take_kind},
        /* comes before the lamps, whose number the bank limits */
        {"bank", bank_option, NULL, take_bank},
        {"lamps", lamps_option, "Number of lamps, or a file with their positions (.lp)",
         take_lamps},
        {"radius", radius_option, "Distance of the lamps from the sample, in mm", take_radius},
        {"axes", axes_option, NULL, take_axes},
        {"cameras", cameras_option, NULL, take_cameras},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(asked); i++)
        if (asked[i].given && (wrong = asked[i].take(asked[i].given, &rig)))
            return cli_usage(call->command, "--%s: %s", asked[i].name, wrong);
    g_autoptr(OutputFile) file = cli_output(path, NULL, error);
    if (!file)
        return CLI_FAILED;
    for (gsize i = 0; i < G_N_ELEMENTS(asked); i++) {
        g_autofree char *usual = g_strdup_printf("%d", new_rig_lamps(rig.kind));
        const char *const defaults[] = {new_rig_kinds[0], "", usual, "400", "", ""};
        const gboolean known = asked[i].take == take_radius && rig.positions && !rig.far;
        if (!asked[i].given && asked[i].question && !known)
            ask(asked[i].question, defaults[i], asked[i].take, &rig);
    }
    ask_ways(&rig);
    if (!offline)
        ask_board(&rig, problems);
    const struct finder_modbus modbus = {0};
    g_autoptr(GPtrArray) found =
        offline || !needs_scan(&rig) ? found_list_new() : finder_scan(&modbus, problems, error);
    if (!found)
        return CLI_FAILED;
    if (!offline)
        ask_cameras(&rig, found, problems);
    place_positions(&rig, path);
    g_autofree char *text = new_rig_text(&rig, found, missing);
    g_autofree struct rig *geometry = g_new0(struct rig, 1);
    if (!devices_parse_geometry(text, path, geometry, error) || !write_text(file, text, error))
        return CLI_FAILED;
    tell(call->record, path, &rig, missing);
    cli_tell_output(call->record, file);
    for (guint i = 0; i < problems->len && !cli_json; i++)
        g_printerr("mesorig: %s\n", (char *)problems->pdata[i]);
    return CLI_DONE;
}

const struct command cli_new_rig = {
    .name = "new-rig",
    .arguments = "FILE.conf",
    .examples = "  mesorig new-rig rig.conf\n"
                "  mesorig new-rig dome.conf --kind dome --lamps 64 --radius 400 --offline\n"
                "  mesorig new-rig dome.conf --kind dome --lamps dome.lp --radius 400 --bank "
                "serial:/dev/ttyACM0 --cameras still:usb\n"
                "  mesorig new-rig table.conf --kind turntable --axes gcode:/dev/ttyUSB0 --bank "
                "wled:10.0.0.7\n",
    .help = "Write a first rig file for the devices that are plugged in. Asks for the kind of rig, "
            "the number of lamps and their distance, and what operates axes, lamps and cameras, "
            "unless options give them.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
