#include "new_rig_text.h"
#include "rig/devices.h"

#include "drivers/found.h"

#include <math.h>
#include <string.h>

const char *const new_rig_kinds[] = {"dome", "turntable", "arc", NULL};

const struct new_rig_way new_rig_axes[] = {
    {"tic"},
    {"gcode", "Serial port of the G-code board", "/dev/ttyUSB0"},
    {"program", "Path of the program, and its arguments after “;”",
     "/usr/local/lib/mesorig/axis.py"},
    {NULL}};
const struct new_rig_way new_rig_banks[] = {
    {"relays", .max_lamps = 64},
    {"serial", "Serial port of the LED controller", "/dev/ttyACM0", 64},
    {"artnet", "Address of the Art-Net node", "192.168.1.50", RIG_MAX_LAMPS},
    {"sacn", "Address of the sACN receiver, or multicast", "multicast", RIG_MAX_LAMPS},
    {"wled", "Address of the WLED controller", "192.168.1.50", RIG_MAX_LAMPS},
    {"program", "Path of the program, and its arguments after “;”",
     "/usr/local/lib/mesorig/lamps.py", RIG_MAX_LAMPS},
    {NULL}};
const struct new_rig_way new_rig_cameras[] = {
    {"found"},
    {"still",
     "Port of the still camera: usb, its place on USB such as 1-2.4, or ptpip:ADDRESS:15740:15740",
     "usb"},
    {"program", "Path of the program, and its arguments after “;”",
     "/usr/share/mesorig/programs/rpicam.py"},
    {NULL}};

#define USB_MAX_LAMPS 8 /* maximum number of lamps of a USB relay board */
/* Size in pixels that is assumed for a camera that does not report the size of its pictures. */
#define WIDTH  1920
#define HEIGHT 1080
/* Width that each picture is assumed to show in the plane of the sample. */
#define FIELD_MM 200.0
/* Exposure time at which white paper under one lamp of 1 W/sr is assumed to be white in a
 * picture. */
#define WHITE_S (1.0 / 60)
#define BITS    12 /* number of bits that is assumed for a camera that does not report it */

int new_rig_lamps(enum new_rig_kind kind) {
    static const int usual[] = {64, 16, 5};
    return usual[kind];
}

/* Returns the n-th device, counted from 0, whose section begins with text, or NULL if there is
 * none. */
static const struct found *find(const GPtrArray *found, const char *text, int n) {
    for (guint i = 0; i < found->len; i++) {
        const struct found *device = found->pdata[i];
        if (device->section && g_str_has_prefix(device->section, text) && n-- == 0)
            return device;
    }
    return NULL;
}

/* Appends a heading, and the keys of a device that was found. The alternative keys, which follow “#
 * or, ”, are left out. */
static void append_found(GString *to, const char *heading, const struct found *device) {
    const char *keys = strchr(device->section, '\n');
    const char *end = strstr(device->section, "# or, ");

    /* A device chooses its own name. A line break in the name would end the comment. */
    g_autofree char *name = g_strdup_printf(
        "%s%s%s", device->what, *device->serial ? ", serial number " : "", device->serial);
    g_autofree char *shown = g_utf8_make_valid(name, -1);
    for (char *c = shown; *c; c++)
        if (g_ascii_iscntrl(*c))
            *c = ' ';
    g_string_append_printf(to, "\n# %s\n[%s]\n", shown, heading);
    if (keys)
        g_string_append_len(to, keys + 1, end ? end - keys - 1 : -1);
}

static gboolean has_key(const struct found *device, const char *key) {
    g_autofree char *line = g_strdup_printf("\n%s = ", key);
    return device && strstr(device->section, line);
}

/* Returns the value of a key in the section of a device. Returns `otherwise` if device is NULL, or
 * if the section lacks the key. */
static int number_of(const struct found *device, const char *key, int otherwise) {
    g_autofree char *line = g_strdup_printf("\n%s = ", key);
    const char *at = device ? strstr(device->section, line) : NULL;
    return at ? (int)g_ascii_strtoll(at + strlen(line), NULL, 10) : otherwise;
}

static void append_missing(GString *to, const char *heading, const char *what, GPtrArray *missing) {
    g_string_append_printf(to,
                           "\n# NOT FOUND: %s. Write the section that “mesorig devices” prints, or "
                           "one of\n# /usr/share/mesorig/devices.\n[%s]\n",
                           what, heading);
    g_ptr_array_add(missing, g_strdup_printf("%s, for [%s]", what, heading));
}

/* Appends the keys of a device that a program operates. The name of the device becomes the last
 * argument, because two sections must not have the same program with the same arguments. `name` may
 * be NULL. */
static void append_program(GString *to, const char *driver, const char *place, const char *name) {
    const char *rest = strchr(place, ';');
    const int n = rest ? (int)(rest - place) : (int)strlen(place);
    g_string_append_printf(to, "driver = %s\nprogram = %.*s\n", driver, n, place);
    if (rest || name)
        g_string_append_printf(to, "arguments = %s%s%s\n", rest ? rest + 1 : "",
                               rest && name ? "; " : "", name ? name : "");
}

/* Appends the keys of axis n of a G-code board. */
static void append_gcode(GString *to, const struct new_rig *rig, const char *name, int n,
                         GPtrArray *missing) {
    const char *dialect = rig->dialect && *rig->dialect ? rig->dialect : "grbl";
    g_autofree char *heading = g_strdup_printf("axis %s", name);

    if (rig->firmware) {
        g_string_append_printf(to, "\n# %s\n[%s]\n", rig->firmware, heading);
    } else if (rig->dialect) {
        g_autofree char *what = g_strdup_printf("a G-code board at %s", rig->axes_at);
        append_missing(to, heading, what, missing);
    } else {
        g_string_append_printf(to, "\n[%s]\n", heading);
    }
    g_string_append(to, "driver = gcode-axis\n");
    if (!rig->firmware)
        g_string_append(to, "# CHECK: language of the board: grbl, marlin or klipper\n");
    g_string_append_printf(to, "dialect = %s\nport = %s\n", dialect, rig->axes_at);
    if (rig->baud > 0 && rig->baud != 115200)
        g_string_append_printf(to, "baud = %d\n", rig->baud);
    if (g_str_equal(dialect, "klipper"))
        g_string_append(to,
                        "# a restart of Klipper after an emergency stop takes this long\nboot_ms "
                        "= 20000\n");
    else if (g_str_equal(dialect, "marlin"))
        g_string_append(to, "boot_ms = 10000\n");
    g_string_append_printf(
        to,
        "letter = %c\n# CHECK: units of the board in a degree; 1 if it counts degrees\n"
        "units_per_deg = 1\n# CHECK: “here” is for an axis without a switch: its present position "
        "becomes home_deg.\n# With a switch: axis, or all for GRBL\nhoming = here\n",
        "XYZ"[n]);
}

static void append_axis(GString *to, const struct new_rig *rig, const char *name, int n,
                        const GPtrArray *found, GPtrArray *missing) {
    const struct found *device = find(found, "[axis NAME]\ndriver = tic-axis\n", n);
    g_autofree char *heading = g_strdup_printf("axis %s", name);

    if (rig->axes == NEW_RIG_GCODE) {
        append_gcode(to, rig, name, n, missing);
    } else if (rig->axes == NEW_RIG_AXIS_PROGRAM) {
        g_string_append_printf(to, "\n[%s]\n", heading);
        append_program(to, "program-axis", rig->axes_at, name);
    } else if (device) {
        append_found(to, heading, device);
    } else {
        append_missing(to, heading, "a stepper controller", missing);
        g_string_append_printf(to, "driver = tic-axis\nserial = 0000000%d\n", n + 1);
    }
    if (rig->axes == NEW_RIG_TIC)
        g_string_append(to, "# CHECK: microsteps in a degree of the axis\nsteps_per_deg = 100\n");
    else
        g_string_append(to, "# CHECK: top speed and acceleration of the axis\nspeed_deg_s = 20\n"
                            "accel_deg_s2 = 40\n");
    g_string_append(to, g_str_equal(name, "turntable") ? "wraps = yes\n"
                                                       : "min_deg = -170\nmax_deg = 170\n");
}

/* Returns the origin of the geometry in words. */
static const char *middle_of(const struct new_rig *rig) {
    return rig->kind == NEW_RIG_DOME ? "middle of the sample's place"
                                     : "middle of the turntable's top";
}

/* Appends the keys that place the lamps. */
static void append_places(GString *to, const struct new_rig *rig) {
    const int n = rig->n_lamps;

    if (rig->positions) {
        g_string_append_printf(
            to, "# the lamps in the order in which the bank numbers them\npositions = %s\n",
            rig->positions);
        if (!rig->far)
            return;
    } else if (rig->kind == NEW_RIG_DOME) {
        g_string_append_printf(
            to,
            "# CHECK: places of the lamps in the order in which the bank numbers them. These three "
            "keys put the\n# lamps on a spiral between two polar angles, 0 being straight above. "
            "Most domes have rings: give\n# rings = theta:count; …, or positions = FILE.lp, "
            "instead.\ncount = "
            "%d\ntheta_from_deg = 12\ntheta_to_deg = 80\n",
            n);
    } else if (rig->kind == NEW_RIG_TURNTABLE) {
        g_string_append(to,
                        "# CHECK: rings of lamps, as polar angle:number. A ring begins at azimuth "
                        "0.\n");
        if (n % 2 == 0 && n >= 4)
            g_string_append_printf(to, "rings = 30:%d; 60:%d\n", n / 2, n / 2);
        else
            g_string_append_printf(to, "rings = 45:%d\n", n);
    } else {
        g_string_append(to,
                        "# CHECK: polar angles of the lamps on the arc, 0 being straight above\n"
                        "theta_deg = ");
        for (int i = 0; i < n; i++)
            g_string_append_printf(to, "%s%.4g", i ? "; " : "",
                                   n > 1 ? 15 + 60.0 * i / (n - 1) : 45);
        g_string_append_c(to, '\n');
    }
    g_string_append_printf(to, "# their distance from the %s\ndistance_mm = %g\n", middle_of(rig),
                           rig->radius_mm);
}

/* Appends the keys of a bank of lamps that is not a relay board. */
static void append_bank(GString *to, const struct new_rig *rig) {
    const char *at = rig->bank_at, *port = strrchr(at, ':');

    switch (rig->bank) {
    case NEW_RIG_SERIAL:
        g_string_append_printf(to, "driver = serial-lamps\nport = %s\n", at);
        return; /* the controller says how many lamps it has */
    case NEW_RIG_LAMP_PROGRAM:
        append_program(to, "program-lamps", at, NULL);
        return;
    case NEW_RIG_SACN:
        g_string_append(to, "driver = sacn-lamps\n");
        if (*at)
            g_string_append_printf(to, "address = %s\n", at);
        break;
    case NEW_RIG_WLED:
        g_string_append_printf(to, "driver = wled-lamps\naddress = %.*s\n",
                               port ? (int)(port - at) : (int)strlen(at), at);
        if (port)
            g_string_append_printf(to, "http_port = %s\n", port + 1);
        break;
    default:
        g_string_append_printf(to, "driver = artnet-lamps\naddress = %s\n", at);
        break;
    }
    g_string_append(to,
                    rig->bank == NEW_RIG_WLED
                        ? "# CHECK: first LED of the first lamp, and number of LEDs of each "
                          "lamp\nfirst_led = 0\nleds = 1\n"
                        : "# CHECK: universe and first channel of the first lamp\nuniverse = 1\n"
                          "start = 1\n");
    g_string_append_printf(to, "n = %d\n", rig->n_lamps);
}

static void append_lamps(GString *to, const struct new_rig *rig, const GPtrArray *found,
                         GPtrArray *missing) {
    static const char *const names[] = {"dome", "ring", "arc"};
    const struct found *usb = find(found, "[lamps NAME]\ndriver = usb-relays", 0);
    g_autofree char *heading = g_strdup_printf("lamps %s", names[rig->kind]);

    if (rig->bank != NEW_RIG_RELAYS) {
        g_string_append_printf(to, "\n[%s]\n", heading);
        append_bank(to, rig);
    } else if (usb && rig->n_lamps <= USB_MAX_LAMPS) {
        append_found(to, heading, usb);
        g_string_append_printf(to, "n_lamps = %d\n", rig->n_lamps);
    } else {
        const char *line = "/dev/ttyUSB0";
        for (guint i = 0; i < found->len; i++) {
            const struct found *device = found->pdata[i];
            if (g_str_has_prefix(device->address, "/dev/ttyUSB") ||
                g_str_has_prefix(device->address, "/dev/ttyACM")) {
                line = device->address;
                break;
            }
        }
        g_autofree char *board = g_strdup_printf("a relay board for %d lamps", rig->n_lamps);
        append_missing(to, heading, board, missing);
        g_string_append_printf(to, "driver = modbus-relays\nbus = %s\nunit = 1\nn = %d\n", line,
                               rig->n_lamps);
    }
    append_places(to, rig);
}

char *new_rig_camera(const struct new_rig *rig) {
    GString *text = g_string_new("[camera NAME]\n");
    if (rig->camera == NEW_RIG_CAMERA_PROGRAM)
        append_program(text, "program-camera", rig->camera_at, NULL);
    else if (rig->camera == NEW_RIG_STILL)
        g_string_append_printf(text, "driver = gphoto2-camera\nport = %s\n", rig->camera_at);
    return g_string_free(text, rig->camera == NEW_RIG_FOUND);
}

/* Appends the section of camera i of n cameras. device is NULL if no camera was found. */
static void append_camera(GString *to, const struct new_rig *rig, int i, int n,
                          const struct found *device, GPtrArray *missing) {
    g_autofree char *asked = new_rig_camera(rig);
    const int width = rig->width > 0 ? rig->width : number_of(device, "width", WIDTH);
    const double distance_mm = 1.5 * rig->radius_mm;
    const double white_dn = ldexp(1, rig->bits > 0 ? rig->bits : BITS);
    const gboolean overhead = rig->kind == NEW_RIG_DOME;
    g_autofree char *heading =
        n > 1 ? g_strdup_printf("camera cam%d", i + 1) : g_strdup("camera cam");

    if (asked) {
        g_string_append_printf(to, "\n[%s]%s", heading, strchr(asked, '\n'));
    } else if (device) {
        append_found(to, heading, device);
    } else {
        append_missing(to, heading, "a camera", missing);
        g_string_append(to, "driver = v4l2-camera\ndevice = /dev/video0\n");
    }
    if (rig->width > 0)
        g_string_append_printf(to, "width = %d\nheight = %d\n", rig->width, rig->height);
    else if (!has_key(device, "width"))
        g_string_append_printf(
            to, "# CHECK: size of its pictures, in pixels\nwidth = %d\nheight = %d\n", WIDTH,
            HEIGHT);
    g_string_append_printf(
        to,
        "# CHECK: focal length of the lens divided by the width of a pixel, or "
        "width × distance_mm\n# divided by the width in mm that a picture shows "
        "there\nfocal_px = %.0f\n# CHECK: its place. It points at the %s\n%stheta_deg = "
        "%.4g\nphi_deg = %d\ndistance_mm = %g\n",
        MAX(1, width * distance_mm / FIELD_MM), middle_of(rig),
        overhead ? "# phi_deg = 270: azimuth 0 is at the right edge of the picture, and 90 at its "
                   "upper edge\n"
                 : "",
        overhead ? 0
        : n > 1  ? 15 + 60.0 * i / (n - 1)
                 : 30,
        overhead ? 270 : 180, distance_mm);
    /* A white surface that a lamp of intensity I lights from the distance r has the radiance E/π =
     * I/(π r²), with I = 1 W/sr. It gives white_dn after WHITE_S. */
    g_string_append_printf(
        to,
        "# A guess. Reflectances are wrong by a common factor until a white tile "
        "is measured\n# (mesorig calibrate radiometry).\nresponse = %.2g\n",
        white_dn / WHITE_S * G_PI * pow(rig->radius_mm / 1000, 2));
}

char *new_rig_text(const struct new_rig *rig, const GPtrArray *found, GPtrArray *missing) {
    GString *text = g_string_new(NULL);
    int n_cameras = 0;

    while (rig->camera == NEW_RIG_FOUND && n_cameras < RIG_MAX_CAMERAS &&
           find(found, "[camera ", n_cameras))
        n_cameras++;
    g_string_append_printf(text,
                           "# A rig of the kind “%s”, made by “mesorig new-rig”. rig.conf(5) "
                           "explains every key.\n# Lengths are in millimetres, angles in degrees. "
                           "Correct what stands below CHECK and NOT FOUND.\n\n[rig]\nid = %s\n",
                           new_rig_kinds[rig->kind], rig->id);
    if (rig->kind == NEW_RIG_ARC)
        g_string_append_printf(text,
                               "# CHECK: radius of the arc's inner edge, and width of the arc with "
                               "its lamps\narc_radius_mm = %g\narc_width_mm = 30\n",
                               rig->radius_mm);
    if (rig->kind != NEW_RIG_DOME)
        append_axis(text, rig, "turntable", 0, found, missing);
    if (rig->kind == NEW_RIG_ARC)
        append_axis(text, rig, "arc", 1, found, missing);
    append_lamps(text, rig, found, missing);
    if (rig->kind == NEW_RIG_DOME)
        n_cameras = MIN(n_cameras, 1);
    for (int i = 0; i < MAX(n_cameras, 1); i++)
        append_camera(text, rig, i, MAX(n_cameras, 1),
                      n_cameras > 0 ? find(found, "[camera ", i) : NULL, missing);
    return g_string_free(text, FALSE);
}
