#include "described_camera.h"

#include <string.h>

struct _DescribedCamera {
    ArvDevice parent;
    char *xml;
    gsize size;
    ArvGc *gc;
    GHashTable *bytes; /* address → value + 1 */
    guint8 fill;
    guint writes;
};

G_DECLARE_FINAL_TYPE(DescribedCamera, described_camera, DESCRIBED, CAMERA, ArvDevice)
G_DEFINE_TYPE(DescribedCamera, described_camera, ARV_TYPE_DEVICE)

static gboolean described_camera_read(ArvDevice *device, guint64 address, guint32 size,
                                      void *buffer, GError **error) {
    DescribedCamera *camera = DESCRIBED_CAMERA(device);
    for (guint32 i = 0; i < size; i++) {
        gint64 at = (gint64)(address + i);
        guint is = GPOINTER_TO_UINT(g_hash_table_lookup(camera->bytes, &at));
        ((guint8 *)buffer)[i] = is > 0 ? (guint8)(is - 1) : camera->fill;
    }
    return TRUE;
}

static gboolean described_camera_write(ArvDevice *device, guint64 address, guint32 size,
                                       void *buffer, GError **error) {
    DescribedCamera *camera = DESCRIBED_CAMERA(device);
    camera->writes++;
    for (guint32 i = 0; i < size; i++) {
        gint64 at = (gint64)(address + i);
        g_hash_table_insert(camera->bytes, g_memdup2(&at, sizeof at),
                            GUINT_TO_POINTER(((guint8 *)buffer)[i] + 1u));
    }
    return TRUE;
}

static gboolean described_camera_read_register(ArvDevice *device, guint64 address, guint32 *value,
                                               GError **error) {
    return described_camera_read(device, address, sizeof *value, value, error);
}

static gboolean described_camera_write_register(ArvDevice *device, guint64 address, guint32 value,
                                                GError **error) {
    return described_camera_write(device, address, sizeof value, &value, error);
}

static ArvGc *described_camera_genicam(ArvDevice *device) {
    return DESCRIBED_CAMERA(device)->gc;
}

static const char *described_camera_xml(ArvDevice *device, size_t *size) {
    *size = DESCRIBED_CAMERA(device)->size;
    return DESCRIBED_CAMERA(device)->xml;
}

static ArvStream *described_camera_stream(ArvDevice *device, ArvStreamCallback callback,
                                          void *user_data, GDestroyNotify destroy, GError **error) {
    g_set_error_literal(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_UNKNOWN,
                        "a description sends no pictures");
    return NULL;
}

static void described_camera_finalize(GObject *object) {
    DescribedCamera *camera = DESCRIBED_CAMERA(object);
    g_clear_object(&camera->gc);
    g_hash_table_unref(camera->bytes);
    g_free(camera->xml);
    G_OBJECT_CLASS(described_camera_parent_class)->finalize(object);
}

static void described_camera_class_init(DescribedCameraClass *class) {
    ArvDeviceClass *device = ARV_DEVICE_CLASS(class);
    G_OBJECT_CLASS(class)->finalize = described_camera_finalize;
    device->create_stream = described_camera_stream;
    device->get_genicam_xml = described_camera_xml;
    device->get_genicam = described_camera_genicam;
    device->read_memory = described_camera_read;
    device->write_memory = described_camera_write;
    device->read_register = described_camera_read_register;
    device->write_register = described_camera_write_register;
}

static void described_camera_init(DescribedCamera *camera) {
    camera->bytes = g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, NULL);
}

/* The register behind a string of the bootstrap says what the file's head says. */
static void described_camera_name(DescribedCamera *camera, const char *feature,
                                  const char *attribute) {
    ArvDomElement *head = arv_dom_document_get_document_element(ARV_DOM_DOCUMENT(camera->gc));
    ArvGcNode *node = arv_gc_get_node(camera->gc, feature);
    const char *name = head ? arv_dom_element_get_attribute(head, attribute) : NULL;
    if (!name || !ARV_IS_GC_REGISTER(node))
        return;
    guint64 address = arv_gc_register_get_address(ARV_GC_REGISTER(node), NULL);
    guint64 room = arv_gc_register_get_length(ARV_GC_REGISTER(node), NULL);
    g_autofree char *text = g_malloc0(room);
    memcpy(text, name, MIN(strlen(name) + 1, room));
    described_camera_write(ARV_DEVICE(camera), address, (guint32)room, text, NULL);
}

ArvDevice *described_camera_new(const char *xml, gsize size, guint8 fill) {
    DescribedCamera *camera = g_object_new(described_camera_get_type(), NULL);
    camera->xml = g_memdup2(xml, size);
    camera->size = size;
    camera->gc = arv_gc_new(ARV_DEVICE(camera), camera->xml, size);
    camera->fill = fill;
    if (camera->gc) {
        described_camera_name(camera, "DeviceVendorName", "VendorName");
        described_camera_name(camera, "DeviceModelName", "ModelName");
    }
    camera->writes = 0;
    return ARV_DEVICE(camera);
}

guint described_camera_writes(ArvDevice *device) {
    return DESCRIBED_CAMERA(device)->writes;
}
