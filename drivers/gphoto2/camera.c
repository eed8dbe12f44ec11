/* A DSLR or mirrorless camera. Its options become arguments of mesorig-gphoto2. */
#include "program/camera.h"

#include "gphoto2.h"

#include "base/program.h"

#include <string.h>

#define MAX_MS 60000

struct gphoto2_camera {
    struct program_camera program;
    char *port, *model, *iso, *aperture, *shutter;
    char **settings;
    gboolean keep;
    int trigger_ms, readout_ms;
};

#define FIELD(name) G_STRUCT_OFFSET(struct gphoto2_camera, name)

static const struct option options[] = {
    {"port", OPTION_STRING, NULL, 0, 0, "usb", NULL, FIELD(port),
     "Where the camera is: usb (the only camera on USB), its place on USB such as 1-2.4, or a port "
     "of libgphoto2 such as ptpip:192.168.1.2:15740:15740"},
    {"model", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(model),
     "The camera's name in libgphoto2, if it is not found by itself"},
    {"iso", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(iso),
     "ISO speed of all pictures; empty leaves the camera's"},
    {"aperture", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(aperture),
     "F-number of all pictures; empty leaves the camera's"},
    {"settings", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(settings),
     "Further settings of libgphoto2, as NAME=VALUE"},
    {"shutter", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(shutter),
     "The setting of libgphoto2 that is the exposure time, if it is not shutterspeed"},
    {"keep_on_card", OPTION_BOOL, NULL, 0, 0, "no", NULL, FIELD(keep),
     "Leave the pictures on the camera's card"},
    {"trigger_ms", OPTION_INT, "ms", 0, MAX_MS, "500", NULL, FIELD(trigger_ms),
     "Longest time from the trigger to the beginning of the exposure"},
    {"readout_ms", OPTION_INT, "ms", 1, MAX_MS, "3000", NULL, FIELD(readout_ms),
     "Time from the end of the exposure until the picture is on this computer and decoded"},
    {"start_s", OPTION_DOUBLE, "s", 0.1, 120, "30", NULL, FIELD(program.command.start_s),
     "Time that the camera may take to be found and to take its first picture"},
    {NULL},
};

static void add(GPtrArray *arguments, const char *option, const char *value) {
    if (value && *value)
        g_ptr_array_add(arguments, g_strdup_printf("--%s=%s", option, value));
}

static void add_number(GPtrArray *arguments, const char *option, int value) {
    g_ptr_array_add(arguments, g_strdup_printf("--%s=%d", option, value));
}

static char **make_arguments(const struct gphoto2_camera *priv) {
    GPtrArray *arguments = g_ptr_array_new();
    add(arguments, "port", priv->port);
    add(arguments, "model", priv->model);
    add(arguments, "iso", priv->iso);
    add(arguments, "aperture", priv->aperture);
    add(arguments, "shutter", priv->shutter);
    for (char **setting = priv->settings; setting && *setting; setting++)
        add(arguments, "set", *setting);
    if (priv->keep)
        g_ptr_array_add(arguments, g_strdup("--keep-on-card"));
    add_number(arguments, "trigger-ms", priv->trigger_ms);
    add_number(arguments, "readout-ms", priv->readout_ms);
    g_ptr_array_add(arguments, NULL);
    return (char **)g_ptr_array_free(arguments, FALSE);
}

static void close_camera(Camera *camera) {
    struct gphoto2_camera *priv = camera->device.priv;
    program_camera_close(camera);
    g_clear_pointer(&priv->program.command.path, g_free);
    g_clear_pointer(&priv->program.command.arguments, g_strfreev);
}

static gboolean open_camera(Camera *camera, GError **error) {
    struct gphoto2_camera *priv = camera->device.priv;
    struct program_command *command = &priv->program.command;
    g_autoptr(GError) why = NULL;
    command->path = program_find("mesorig-gphoto2", &why);
    if (!command->path)
        return device_error_set(error, DEVICE_ERROR_DISCONNECTED, camera->device.who, "%s",
                                why->message);
    command->arguments = make_arguments(priv);
    if (program_camera_open(camera, error))
        return TRUE;
    close_camera(camera);
    return FALSE;
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    const struct gphoto2_camera *priv = given;
    for (char **setting = priv->settings; setting && *setting; setting++)
        if (**setting == '=' || !strchr(*setting, '='))
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "settings",
                           "“%s” is not NAME=VALUE; “gphoto2 --list-config” lists the names",
                           *setting);
}

static void needs(gconstpointer given, GPtrArray *to) {
    const struct gphoto2_camera *priv = given;
    g_ptr_array_add(to, g_strdup_printf("the camera at %s", priv->port));
}

const struct camera_driver gphoto2_camera_driver = {
    .info = {"camera", "gphoto2-camera",
             "A DSLR or mirrorless camera, by libgphoto2 (docs/build-a-rig/still-cameras.md)",
             options, sizeof(struct gphoto2_camera), check, needs},
    .open = open_camera,
    .opened = program_camera_opened,
    .close = close_camera,
    .configure = program_camera_configure,
    .arm = program_camera_arm,
    .disarm = program_camera_disarm,
    .trigger = program_camera_trigger,
    .listed_exposures = TRUE,
    .no_stamps = TRUE,
};
