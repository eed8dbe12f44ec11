#include "device.h"

#include "recording.h"

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
                            "%s drives a real device, which cannot work in virtual time; write "
                            "clock = real in [rig]",
                            device->info->name);
}

gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error) {
    g_return_val_if_fail(device && info && section && clock, FALSE);
    g_autoptr(GPtrArray) keys =
        g_ptr_array_new(); /* all keys that are allowed in addition to the driver's options */
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
    recording_section(section);
    recording_device(device->who, "open");
    return TRUE;
}

void device_set_identity(struct device *device, const char *model, const char *serial,
                         const char *address) {
    const gboolean has_serial = serial && *serial, has_address = address && *address;
    g_autofree char *text = g_strdup_printf("%s%s%s", model ? model : "",
                                            has_serial    ? ", serial number "
                                            : has_address ? ", at "
                                                          : "",
                                            has_serial    ? serial
                                            : has_address ? address
                                                          : "");
    g_autofree char *valid = g_utf8_make_valid(g_strstrip(text), -1);
    for (char *at = valid; *at; at++) /* the identity must be a single line of text */
        *at = g_ascii_iscntrl(*at) ? '?' : *at;
    if (has_serial)
        recording_hide(serial, NULL);
    g_free(device->identity);
    device->identity = *valid ? g_steal_pointer(&valid) : NULL;
}

void device_set_permit(struct device *device, DevicePermit permit, gpointer data) {
    device->permit = permit;
    device->permit_data = data;
}

gboolean device_ask_permit(const struct device *device, GError **error) {
    return !device->permit || device->permit(device, device->permit_data, error);
}

gboolean device_is_unsafe(const struct device *device) {
    return device->unsafe != NULL;
}

/* Tells the watching function that the device has become unsafe or safe. The function may close
 * the device. */
static void on_tell(gpointer data) {
    struct device *device = data;
    device->tell = 0;
    if (device->told_unsafe == device_is_unsafe(device))
        return;
    device->told_unsafe = device_is_unsafe(device);
    if (device->watch)
        device->watch(device, device->unsafe, device->watch_data);
}

static void tell_later(struct device *device) {
    if (device->tell == 0 && device->told_unsafe != device_is_unsafe(device))
        device->tell = clock_call_in(device->clock, 0, on_tell, device);
}

void device_watch_safety(struct device *device, DeviceSafetyFunc func, gpointer data) {
    device->watch = func;
    device->watch_data = data;
    device->told_unsafe = FALSE;
    tell_later(device);
}

void device_report_safety(struct device *device, const GError *unsafe) {
    if (!unsafe)
        g_clear_error(&device->unsafe);
    else if (!device->unsafe)
        device->unsafe = g_error_copy(unsafe);
    tell_later(device);
}

void device_clear(struct device *device) {
    if (!device || !device->info)
        return;
    clock_cancel(device->clock, &device->tell);
    g_clear_error(&device->unsafe);
    options_clear(device->info->options, device->priv);
    g_clear_pointer(&device->priv, g_free);
    g_clear_pointer(&device->name, g_free);
    g_clear_pointer(&device->who, g_free);
    g_clear_pointer(&device->identity, g_free);
    g_clear_pointer(&device->clock, clock_unref);
    device->info = NULL;
}

gboolean device_record_opened(const struct device *device, gboolean opened, GError **error) {
    if (!opened)
        recording_device(device->who, "= failed: %s",
                         error && *error ? (*error)->message : "no reason was given");
    else
        recording_device(device->who, "= opened%s%s", device->identity ? ": " : "",
                         device->identity ? device->identity : "");
    return opened;
}
