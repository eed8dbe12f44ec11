#include "web_products.h"

#include "base/json.h"
#include "web_files.h"

#include <glib/gstdio.h>
#include <libsoup/soup.h>
#include <string.h>
#include <sys/stat.h>

#define MAX_FILE    (256 << 20)
#define N_ARGUMENTS 4

struct kind {
    const char *name, *file, *type;
    const char *arguments[N_ARGUMENTS]; /* of mesorig, before the directory */
};

static const struct kind kinds[] = {
    {"report", "report.html", "text/html; charset=utf-8", {"report"}},
    {"page", "page.html", "text/html; charset=utf-8", {"export", "web"}},
    {"gltf", "material.glb", "model/gltf-binary", {"export", "gltf"}},
};

struct product {
    char *session;
    const struct kind *kind;
    char *path;
    gint64 begun_us; /* real time when it was begun to be made */
};

struct WebProducts {
    char *folder;           /* NULL until the first file is made */
    GPtrArray *list;        /* of struct product, the oldest first */
    struct product *making; /* NULL if no file is being made */
    struct product *failed; /* the last file, if it could not be made */
    char *why;              /* of failed */
    guint n_made;
};

static void product_free(gpointer data) {
    struct product *product = data;
    if (!product)
        return;
    g_unlink(product->path);
    g_free(product->session);
    g_free(product->path);
    g_free(product);
}

WebProducts *web_products_new(void) {
    WebProducts *products = g_new0(WebProducts, 1);
    products->list = g_ptr_array_new_with_free_func(product_free);
    return products;
}

void web_products_free(WebProducts *products) {
    if (!products)
        return;
    g_ptr_array_unref(products->list);
    product_free(products->failed);
    if (products->folder)
        g_rmdir(products->folder);
    g_free(products->folder);
    g_free(products->why);
    g_free(products);
}

/* Returns the time of the last change of a session in µs since 1970: of its data or its products.
 */
static gint64 changed_us(const char *directory) {
    static const char *const parts[] = {"session.db", "products"};
    gint64 last_us = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(parts); i++) {
        struct stat info;
        g_autofree char *path = g_build_filename(directory, parts[i], NULL);
        if (stat(path, &info) == 0)
            last_us =
                MAX(last_us, info.st_mtim.tv_sec * G_USEC_PER_SEC + info.st_mtim.tv_nsec / 1000);
    }
    return last_us;
}

static gboolean is_current(const struct web_task *task, const struct product *product) {
    g_autofree char *name = g_strconcat(product->session, ".session", NULL);
    g_autofree char *directory = g_build_filename(task->folder, name, NULL);
    return changed_us(directory) <= product->begun_us;
}

static struct product *find(const struct web_task *task, const struct kind *kind) {
    const GPtrArray *list = task->products->list;
    for (guint i = list->len; i-- > 0;) {
        struct product *product = list->pdata[i];
        if (product->kind == kind && strcmp(product->session, task->name) == 0 &&
            is_current(task, product))
            return product;
    }
    return NULL;
}

static void on_made(gboolean ok, const char *text, gpointer data) {
    WebProducts *products = data;
    struct product *product = g_steal_pointer(&products->making);
    if (ok) {
        g_ptr_array_add(products->list, product);
        if (products->list->len > WEB_PRODUCTS_MAX)
            g_ptr_array_remove_index(products->list, 0);
    } else {
        products->failed = product;
        products->why = g_strdup(text);
    }
}

/* Starts the child process. Returns FALSE with an error if it cannot be started. */
static gboolean start(const struct web_task *task, const char *directory, const struct kind *kind,
                      GError **error) {
    WebProducts *products = task->products;
    if (!products->folder && !(products->folder = g_dir_make_tmp("mesorig-web-XXXXXX", error)))
        return FALSE;
    g_autofree char *name = g_strdup_printf("%u-%s", ++products->n_made, kind->file);
    g_autofree char *path = g_build_filename(products->folder, name, NULL);
    const char *arguments[N_ARGUMENTS + 4];
    int n = 0;
    for (int i = 0; i < N_ARGUMENTS && kind->arguments[i]; i++)
        arguments[n++] = kind->arguments[i];
    arguments[n++] = directory;
    arguments[n++] = "-o";
    arguments[n++] = path;
    arguments[n] = NULL;
    if (!web_child_start(task->child, arguments, on_made, products, error))
        return FALSE;
    product_free(products->failed);
    products->failed = NULL;
    g_clear_pointer(&products->why, g_free);
    products->making = g_new(struct product, 1);
    *products->making =
        (struct product){g_strdup(task->name), kind, g_steal_pointer(&path), g_get_real_time()};
    return TRUE;
}

void web_products_make(const struct web_task *task) {
    const char *wanted = web_task_value(task, "product");
    const struct kind *kind = NULL;
    g_autoptr(GError) error = NULL;
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (g_strcmp0(kinds[i].name, wanted) == 0)
            kind = &kinds[i];
    if (!kind) {
        web_task_refuse(task, SOUP_STATUS_BAD_REQUEST,
                        "the query needs the file to make: product=report, page or gltf");
        return;
    }
    g_autofree char *directory = web_files_directory(task, task->name);
    if (!directory)
        return;
    if (!start(task, directory, kind, &error))
        web_task_refuse(task, SOUP_STATUS_CONFLICT, error->message);
    else
        web_task_answer(task, SOUP_STATUS_OK, "{}\n");
}

static void add_text(GVariantBuilder *to, const char *key, const char *value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(value));
}

/* Returns a GVariant of type maybe: an object that describes the product, or nothing if product is
 * NULL. why may be NULL. */
static GVariant *describe(const struct product *product, const char *why) {
    GVariantBuilder to;
    if (!product)
        return g_variant_new_maybe(G_VARIANT_TYPE_VARDICT, NULL);
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    add_text(&to, "session", product->session);
    add_text(&to, "product", product->kind->name);
    if (why)
        add_text(&to, "why", why);
    return g_variant_new_maybe(NULL, g_variant_builder_end(&to));
}

void web_products_list(const struct web_task *task) {
    const WebProducts *products = task->products;
    GVariantBuilder to, list;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < products->list->len; i++) {
        const struct product *product = products->list->pdata[i];
        struct stat info;
        if (!is_current(task, product) || stat(product->path, &info) != 0)
            continue;
        g_variant_builder_open(&list, G_VARIANT_TYPE_VARDICT);
        add_text(&list, "session", product->session);
        add_text(&list, "product", product->kind->name);
        add_text(&list, "file", product->kind->file);
        g_variant_builder_add(&list, "{sv}", "bytes", g_variant_new_int64(info.st_size));
        g_variant_builder_close(&list);
    }
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "making", describe(products->making, NULL));
    g_variant_builder_add(&to, "{sv}", "failed", describe(products->failed, products->why));
    g_variant_builder_add(&to, "{sv}", "products", g_variant_builder_end(&list));
    g_autofree char *json = json_text(g_variant_builder_end(&to));
    web_task_answer(task, SOUP_STATUS_OK, json);
}

static void send_file(const struct web_task *task, const struct kind *kind) {
    const struct product *product = find(task, kind);
    g_autoptr(GMappedFile) file = product ? g_mapped_file_new(product->path, FALSE, NULL) : NULL;
    if (!file || g_mapped_file_get_length(file) > MAX_FILE) {
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "this file was not made, or the session was changed later: POST "
                        "sessions/NAME/make makes it; a file of more than 256 MiB is not sent");
        return;
    }
    g_autoptr(GBytes) bytes = g_mapped_file_get_bytes(file);
    web_task_bytes(task, kind->type, bytes);
}

void web_products_report(const struct web_task *task) {
    send_file(task, &kinds[0]);
}

void web_products_page(const struct web_task *task) {
    send_file(task, &kinds[1]);
}

void web_products_gltf(const struct web_task *task) {
    send_file(task, &kinds[2]);
}
