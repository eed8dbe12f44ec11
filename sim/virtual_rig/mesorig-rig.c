/* mesorig-rig: a rig of virtual devices on this machine, to try the real drivers with. */
#include "base/nearest.h"
#include "rig.h"
#include "virtual/testbed.h"

#include <gio/gunixinputstream.h>
#include <glib-unix.h>
#include <glib/gstdio.h>
#include <locale.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

static char *virtual_path, *out_path, **usb, **u3v;
static gboolean json, version;
static double loss;

static const GOptionEntry entries[] = {
    {"virtual", 0, 0, G_OPTION_ARG_FILENAME, &virtual_path,
     "Stand for the devices of this simulated rig", "RIG"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &out_path,
     "Write the rig file for the real drivers here; default: to standard output", "FILE"},
    {"usb", 0, 0, G_OPTION_ARG_STRING_ARRAY, &usb,
     "This device is on USB: a Tic, a relay board, a V4L2 camera; all: every one", "NAME"},
    {"u3v", 0, 0, G_OPTION_ARG_STRING_ARRAY, &u3v,
     "This camera is a USB3 Vision camera; all: every one", "NAME"},
    {"loss", 0, 0, G_OPTION_ARG_DOUBLE, &loss,
     "This part of the cameras' packets is lost on the way, 0 to 1", "PART"},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Say as JSON what there is", NULL},
    {"version", 0, 0, G_OPTION_ARG_NONE, &version, "Print the version", NULL},
    {NULL},
};

/* Writes the rig file, and prints the virtual devices as text or JSON. */
static gboolean virtual_rig_main_write_file(const VirtualRig *rig, GError **error) {
    gsize n;
    const struct virtual_rig_device *devices = virtual_rig_devices(rig, &n);
    g_autofree char *environment = virtual_rig_environment(rig);
    if (!out_path) {
        g_print("%s", virtual_rig_text(rig));
        return TRUE;
    }
    if (!g_file_set_contents(out_path, virtual_rig_text(rig), -1, error))
        return FALSE;
    if (json) {
        g_autofree char *path = g_strescape(out_path, NULL);
        g_print("{\"rig\":\"%s\",\"devices\":[", path);
        for (gsize i = 0; i < n; i++)
            g_print("%s{\"section\":\"%s\",\"driver\":\"%s\",\"where\":\"%s\"}", i ? "," : "",
                    devices[i].section, devices[i].driver, devices[i].where);
        g_print("],\"environment\":\"%s\"}\n", environment ? environment : "");
        return TRUE;
    }
    for (gsize i = 0; i < n; i++)
        g_print("%-20s %-15s %s\n", devices[i].section, devices[i].driver, devices[i].where);
    g_print("\n%s is the rig file. In another terminal:\n"
            "  %s%smesorigd --listen unix:path=/tmp/mesorig-virtual --rig %s\n"
            "  mesorig capture --address unix:path=/tmp/mesorig-virtual %s SESSION -o DIR\n"
            "Ctrl-C ends the devices; “help” and Enter says what else can be done to them here.\n",
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
        g_printerr("unplug NAME   cut a device off, by the name of its section\n"
                   "plug NAME     connect it again\n"
                   "world FILE    lay the sample of this world file on the turntable\n"
                   "help          this list\n");
    }
    if (error)
        g_printerr("mesorig-rig: %s\n", error->message);
}

static void read_command(GDataInputStream *in, VirtualRig *rig);

static void on_line(GObject *source, GAsyncResult *result, gpointer rig) {
    g_autofree char *line =
        g_data_input_stream_read_line_finish(G_DATA_INPUT_STREAM(source), result, NULL, NULL);
    if (!line)
        return; /* the end of standard input does not end the devices */
    obey(rig, g_strstrip(line));
    read_command(G_DATA_INPUT_STREAM(source), rig);
}

static void read_command(GDataInputStream *in, VirtualRig *rig) {
    g_data_input_stream_read_line_async(in, G_PRIORITY_DEFAULT, NULL, on_line, rig);
}

/* Returns NULL in a background job, which the terminal would stop when it reads. */
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
    g_autoptr(VirtualRig) rig =
        virtual_rig_new(virtual_path, (const char *const *)usb, (const char *const *)u3v, &error);
    if (!rig || !virtual_rig_main_write_file(rig, &error)) {
        g_printerr("mesorig-rig: %s\n", error->message);
        return 1;
    }
    fflush(stdout);
    struct virtual_camera_faults faults = {.loss = loss};
    virtual_rig_fail_cameras(rig, &faults);
    setvbuf(stdout, NULL, _IOLBF, 0);
    g_autoptr(GMainLoop) loop = g_main_loop_new(NULL, FALSE);
    g_autoptr(GDataInputStream) input = listen_to_input(rig);
    g_unix_signal_add(SIGINT, virtual_rig_main_on_signal, loop);
    g_unix_signal_add(SIGTERM, virtual_rig_main_on_signal, loop);
    g_main_loop_run(loop);
    if (out_path)
        g_unlink(out_path); /* the rig file is useless without its devices */
    return 0;
}

int main(int argc, char **argv) {
    setlocale(LC_ALL, "");
    g_auto(GStrv) again = g_strdupv(argv);
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) options = g_option_context_new(NULL);
    g_option_context_set_summary(
        options,
        "A rig of virtual devices on this machine that speak the real protocols: GigE Vision\n"
        "cameras, Modbus RTU axes, Modbus TCP lamps, lasers and interlocks, which all see\n"
        "and change the world of a simulated rig. With --usb: Pololu Tics, USB relay boards\n"
        "and V4L2 cameras; with --u3v: USB3 Vision cameras.");
    g_option_context_add_main_entries(options, entries, NULL);
    if (!g_option_context_parse(options, &argc, &argv, &error)) {
        nearest_add_option(error, (const GOptionEntry *const[]){entries, NULL});
        g_printerr("mesorig-rig: %s\n", error->message);
        return 2;
    }
    if (version) {
        g_print("mesorig-rig %s\n", MESORIG_VERSION);
        return 0;
    }
    if (!virtual_path || argc > 1 || !(loss >= 0 && loss <= 1) || (json && !out_path)) {
        g_printerr(
            "usage: mesorig-rig --virtual RIG [-o FILE] [--usb NAME…] [--u3v NAME…] [--loss PART]\n"
            "       [--json]\n"
            "--json needs -o; PART is between 0 and 1\n");
        return 2;
    }
    if (usb || u3v)
        testbed_enter(again);
    return virtual_rig_main_run();
}
