#include "device.h"

GQuark device_error_quark(void) {
    return error_details_domain("device_error");
}

GError *device_error_new(enum device_error code, const char *who, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *error = error_details_new_valist(DEVICE_ERROR, (gint)code, who, format, args);
    va_end(args);
    return error;
}

void device_error_set(GError **error, enum device_error code, const char *who, const char *format,
                      ...) {
    va_list args;
    va_start(args, format);
    g_propagate_error(error, error_details_new_valist(DEVICE_ERROR, (gint)code, who, format, args));
    va_end(args);
}

/* The keys of the class or rig, and the one that chose the driver. */
static const char **add_driver_key(const char *const *also) {
    GPtrArray *keys = g_ptr_array_new();
    g_ptr_array_add(keys, (gpointer) "driver");
    for (; also && *also; also++)
        g_ptr_array_add(keys, (gpointer)*also);
    g_ptr_array_add(keys, NULL);
    return (const char **)g_ptr_array_free(keys, FALSE);
}

gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error) {
    g_return_val_if_fail(device && info && section && clock, FALSE);
    g_autofree const char **keys = add_driver_key(also);
    gpointer priv = g_malloc0(MAX(info->priv_size, 1));
    if (!options_parse(info->options, section, keys, priv, error)) {
        g_free(priv);
        return FALSE;
    }
    device->info = info;
    device->name = g_strdup(section->name ? section->name : section->class_name);
    device->who = g_strdup_printf("%s %s", info->class_name, device->name);
    device->clock = clock_ref(clock);
    device->priv = priv;
    device->section = section;
    return TRUE;
}

void device_clear(struct device *device) {
    if (!device || !device->info)
        return;
    options_clear(device->info->options, device->priv);
    g_clear_pointer(&device->priv, g_free);
    g_clear_pointer(&device->name, g_free);
    g_clear_pointer(&device->who, g_free);
    g_clear_pointer(&device->clock, clock_unref);
    device->info = NULL;
}
