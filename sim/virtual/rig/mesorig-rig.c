/* mesorig-rig makes a rig of virtual devices on this machine. With it, the real drivers can be
 * tried without devices. */
#include "base/data_error.h"
#include "base/json.h"
#include "base/output_file.h"
#include "base/program.h"
#include "rig.h"
#include "virtual/testbed.h"

#include <gio/gunixinputstream.h>
#include <glib-unix.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

static char *virtual_path, *out_path, **usb, **u3v, **still, **gcode, **serial;
static gboolean json, force;
static double loss;

static const GOptionEntry entries[] = {
    {"virtual", 0, 0, G_OPTION_ARG_FILENAME, &virtual_path,
     "The simulated rig whose devices become virtual devices", "RIG"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &out_path,
     "Write the rig file for the real drivers to this file; default: standard output", "FILE"},
    {"usb", 0, 0, G_OPTION_ARG_STRING_ARRAY, &usb,
     "Put this device on USB, as a Tic, a relay board or a V4L2 camera; all: every device", "NAME"},
    {"u3v", 0, 0, G_OPTION_ARG_STRING_ARRAY, &u3v,
     "Make this camera a USB3 Vision camera; all: every camera", "NAME"},
    {"still", 0, 0, G_OPTION_ARG_STRING_ARRAY, &still,
     "Make this camera a still camera on PTP/IP, for libgphoto2; all: every camera", "NAME"},
    {"gcode", 0, 0, G_OPTION_ARG_STRING_ARRAY, &gcode,
     "Put this axis on a board that speaks G-code; all: every axis", "NAME"},
    {"serial", 0, 0, G_OPTION_ARG_STRING_ARRAY, &serial,
     "Put the lamps of this bank on a serial LED controller; all: every bank", "NAME"},
    {"loss", 0, 0, G_OPTION_ARG_DOUBLE, &loss, "Share of the cameras' packets that is lost, 0 to 1",
     "PART"},
    {"force", 0, 0, G_OPTION_ARG_NONE, &force, "Replace an existing output of any kind", NULL},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print the devices as JSON", NULL},
    {NULL},
};

/* Returns the text of the rig file. Its first line has the kind of the file and the checksum of the
 * rest. The checksum shows mesorig-rig, at its end and at its next start, whether somebody has
 * changed the file. */
static char *virtual_rig_main_text(const char *rig) {
    g_autofree char *sum = g_compute_checksum_for_string(G_CHECKSUM_SHA256, rig, -1);
    return g_strdup_printf("# " OUTPUT_FILE_TEXT("virtual rig") ", SHA-256 of what follows %s\n%s",
                           sum, rig);
}

/* Returns whether the file is unchanged since mesorig-rig wrote it. */
static gboolean virtual_rig_main_is_own(const char *path) {
    g_autofree char *text = NULL;
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR) || !g_file_get_contents(path, &text, NULL, NULL))
        return FALSE;
    const char *line = strchr(text, '\n');
    g_autofree char *own = line ? virtual_rig_main_text(line + 1) : NULL;
    return g_strcmp0(own, text) == 0;
}

/* Checks -o before any device exists. Returns NULL with an error if the file must not be
 * replaced. */
static OutputFile *virtual_rig_main_output(GError **error) {
    GStatBuf in, out;
    if (g_stat(virtual_path, &in) == 0 && g_stat(out_path, &out) == 0 && in.st_dev == out.st_dev &&
        in.st_ino == out.st_ino) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                    "-o %s is also the file of --virtual; choose another name for the rig file of "
                    "the virtual devices",
                    out_path);
        return NULL;
    }
    /* Without --force, a file that the user has changed is not replaced. */
    return output_file_new(out_path, virtual_rig_main_is_own(out_path) ? "virtual rig" : NULL,
                           force, error);
}

/* Removes the rig file, because it is useless without its devices. If the user has changed the
 * file, it is kept. */
static void virtual_rig_main_remove_file(void) {
    if (virtual_rig_main_is_own(out_path))
        g_unlink(out_path);
    else if (g_file_test(out_path, G_FILE_TEST_IS_REGULAR))
        g_printerr("mesorig-rig: %s was changed while mesorig-rig ran, so the file is kept. The "
                   "devices of the file no longer exist; copy your changes to another rig file\n",
                   out_path);
}

static void virtual_rig_main_print_json(const struct virtual_rig_device *devices, gsize n,
                                        const char *environment) {
    g_autoptr(GString) text = g_string_new("{\"rig\":");
    json_append_string(text, out_path);
    g_string_append(text, ",\"devices\":[");
    for (gsize i = 0; i < n; i++) {
        g_string_append(text, i ? ",{\"section\":" : "{\"section\":");
        json_append_string(text, devices[i].section);
        g_string_append(text, ",\"driver\":");
        json_append_string(text, devices[i].driver);
        g_string_append(text, ",\"where\":");
        json_append_string(text, devices[i].where);
        g_string_append_c(text, '}');
    }
    g_string_append(text, "],\"environment\":");
    json_append_string(text, environment ? environment : "");
    g_print("%s}\n", text->str);
}

/* Writes the rig file, and prints the virtual devices as text or JSON. Without -o, `to` is NULL,
 * and the rig file itself is printed instead. */
static gboolean virtual_rig_main_write_file(const VirtualRig *rig, OutputFile *to, GError **error) {
    gsize n;
    const struct virtual_rig_device *devices = virtual_rig_devices(rig, &n);
    g_autofree char *environment = virtual_rig_environment(rig);
    if (!to) {
        g_print("%s", virtual_rig_text(rig));
        return TRUE;
    }
    g_autofree char *text = virtual_rig_main_text(virtual_rig_text(rig));
    if (!output_file_put(to, text, strlen(text), error))
        return FALSE;
    output_file_say(to, "mesorig-rig");
    if (json) {
        virtual_rig_main_print_json(devices, n, environment);
        return TRUE;
    }
    for (gsize i = 0; i < n; i++)
        g_print("%-20s %-15s %s\n", devices[i].section, devices[i].driver, devices[i].where);
    g_print("\n%s is the rig file. In another terminal:\n  %s%smesorigd --listen "
            "unix:path=/tmp/mesorig-virtual --rig %s\n  mesorig capture --address "
            "unix:path=/tmp/mesorig-virtual %s SESSION -o DIR\nCtrl-C ends the devices; “help” and "
            "Enter lists further actions.\n",
            out_path, environment ? environment : "", environment ? " " : "", out_path, out_path);
    return TRUE;
}

static gboolean virtual_rig_main_on_signal(gpointer data) {
    g_main_loop_quit(data);
    return G_SOURCE_CONTINUE;
}

/* Executes one line of standard input. */
static void obey(VirtualRig *rig, const char *line) {
    g_auto(GStrv) words = g_strsplit(line, " ", 2);
    const char *command = words[0] ? words[0] : "";
    g_autofree char *what = words[0] && words[1] ? g_strstrip(g_strdup(words[1])) : g_strdup("");
    g_autoptr(GError) error = NULL;
    const gboolean plugs = g_str_equal(command, "plug");
    if (!*command)
        return;
    if (*what && (plugs || g_str_equal(command, "unplug"))) {
        if (virtual_rig_plug(rig, what, plugs, &error))
            g_print("%s is %s\n", what, plugs ? "plugged in" : "unplugged");
    } else if (*what && g_str_equal(command, "world")) {
        if (virtual_rig_set_world(rig, what, &error))
            g_print("the world is %s\n", what);
    } else {
        g_printerr("unplug NAME   disconnect a device, by the name of its section\nplug NAME     "
                   "connect it again\nworld FILE    lay the sample of this world file on the "
                   "turntable\nhelp          this list\n");
    }
    if (error)
        g_printerr("mesorig-rig: %s\n", error->message);
}

static void read_command(GDataInputStream *in, VirtualRig *rig);

static void on_line(GObject *source, GAsyncResult *result, gpointer rig) {
    g_autofree char *line =
        g_data_input_stream_read_line_finish(G_DATA_INPUT_STREAM(source), result, NULL, NULL);
    if (!line)
        return; /* the devices continue to run after the end of standard input */
    obey(rig, g_strstrip(line));
    read_command(G_DATA_INPUT_STREAM(source), rig);
}

static void read_command(GDataInputStream *in, VirtualRig *rig) {
    g_data_input_stream_read_line_async(in, G_PRIORITY_DEFAULT, NULL, on_line, rig);
}

/* Begins to read commands from standard input. In a background job, reads nothing and returns NULL,
 * because the terminal stops a background job that reads. */
static GDataInputStream *listen_to_input(VirtualRig *rig) {
    if (isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) != getpgrp())
        return NULL;
    signal(SIGTTIN, SIG_IGN);
    g_autoptr(GInputStream) input = g_unix_input_stream_new(STDIN_FILENO, FALSE);
    GDataInputStream *in = g_data_input_stream_new(input);
    read_command(in, rig);
    return in;
}

static int virtual_rig_main_run(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(OutputFile) to = out_path ? virtual_rig_main_output(&error) : NULL;
    const struct virtual_rig_kinds kinds = {(const char *const *)usb, (const char *const *)u3v,
                                            (const char *const *)still, (const char *const *)gcode,
                                            (const char *const *)serial};
    g_autoptr(VirtualRig) rig = error ? NULL : virtual_rig_new(virtual_path, &kinds, &error);
    /* The signals are caught before the rig file is written. Another program may wait for this file
     * and then end this program at once. This program must then still remove the file. */
    g_autoptr(GMainLoop) loop = g_main_loop_new(NULL, FALSE);
    g_unix_signal_add(SIGINT, virtual_rig_main_on_signal, loop);
    g_unix_signal_add(SIGTERM, virtual_rig_main_on_signal, loop);
    if (!rig || !virtual_rig_main_write_file(rig, to, &error)) {
        g_printerr("mesorig-rig: %s\n", error->message);
        return 1;
    }
    fflush(stdout);
    struct virtual_camera_faults faults = {.loss = loss};
    virtual_rig_fail_cameras(rig, &faults);
    setvbuf(stdout, NULL, _IOLBF, 0);
    g_autoptr(GDataInputStream) input = listen_to_input(rig);
    g_main_loop_run(loop);
    if (to && !output_file_streams(to))
        virtual_rig_main_remove_file();
    return 0;
}

static const struct command_line command_line = {
    .name = "mesorig-rig",
    .summary =
        "A rig of virtual devices on this machine that speak the real protocols: GigE Vision "
        "cameras, Modbus RTU axes, Modbus TCP lamps, lasers and interlocks, which all see and "
        "change "
        "the world of a simulated rig. With --usb: Pololu Tics, USB relay boards and V4L2 cameras. "
        "With --u3v: USB3 Vision cameras. With --still: still cameras on PTP/IP. "
        "With --gcode: axes on boards that speak GRBL. With --serial: lamps on serial LED "
        "controllers.",
    .options = entries,
};

int main(int argc, char **argv) {
    g_auto(GStrv) again = g_strdupv(argv);
    program_parse(&command_line, &argc, &argv);
    if (!virtual_path)
        return program_usage(
            &command_line,
            "the option --virtual is missing; give the file of a simulated rig: --virtual RIG");
    if (!(loss >= 0 && loss <= 1))
        return program_usage(&command_line, "--loss=%g is out of range; give a share from 0 to 1",
                             loss);
    if (json && !out_path)
        return program_usage(
            &command_line,
            "--json prints the devices of the rig file that -o writes; also give -o FILE");
    if (usb || u3v)
        testbed_enter(again);
    return virtual_rig_main_run();
}
