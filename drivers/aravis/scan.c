#include "camera.h"
#include "connect.h"

#include <string.h>

static void scan_found_free(gpointer data) {
    struct aravis_found *found = data;
    g_free(found->id);
    g_free(found->serial);
    g_free(found->address);
    g_free(found->model);
    g_free(found->protocol);
    g_free(found);
}

static int by_id(gconstpointer a, gconstpointer b) {
    const struct aravis_found *const *x = a, *const *y = b;
    return strcmp((*x)->id, (*y)->id);
}

GPtrArray *aravis_scan(void) {
    GPtrArray *all = g_ptr_array_new_with_free_func(scan_found_free);
    aravis_list_lock();
    arv_update_device_list();
    for (guint i = 0; i < arv_get_n_devices(); i++) {
        struct aravis_found *found = g_new0(struct aravis_found, 1);
        found->protocol = g_strdup(arv_get_device_protocol(i));
        found->id = g_strdup(arv_get_device_id(i));
        found->serial = g_strdup(arv_get_device_serial_nbr(i));
        found->model = g_strdup_printf("%s %s", arv_get_device_vendor(i), arv_get_device_model(i));
        if (g_str_equal(found->protocol, "GigEVision"))
            found->address = g_strdup(arv_get_device_address(i));
        g_ptr_array_add(all, found);
    }
    aravis_list_unlock();
    g_ptr_array_sort(all, by_id);
    return all;
}
