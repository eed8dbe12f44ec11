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

gboolean device_error_set(GError **error, enum device_error code, const char *who,
                          const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_propagate_error(error, error_details_new_valist(DEVICE_ERROR, (gint)code, who, format, args));
    va_end(args);
    return FALSE;
}

gboolean device_check_real_clock(const struct device *device, GError **error) {
    return !clock_is_virtual(device->clock) ||
           config_set_error(error, CONFIG_ERROR_VALUE, device->section, "driver",
                            "%s is real and keeps real time; set clock = real in [rig]",
                            device->info->name);
}
gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error) {
    g_return_val_if_fail(device && info && section && clock, FALSE);
    g_autoptr(GPtrArray) keys =
        g_ptr_array_new(); /* all keys that are allowed beside the driver's options */
    g_ptr_array_add(keys, (gpointer) "driver");
    for (; also && *also; also++)
        g_ptr_array_add(keys, (gpointer)*also);
    g_ptr_array_add(keys, NULL);
    gpointer priv = g_malloc0(MAX(info->priv_size, 1));
    if (!options_parse(info->options, section, (const char *const *)keys->pdata, priv, error)) {
        g_free(priv);
        return FALSE;
    }
    g_autoptr(Mistakes) mistakes = mistakes_new();
    if (info->check)
        info->check(priv, section, mistakes);
    if (!mistakes_report(mistakes, error)) {
        options_clear(info->options, priv);
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
