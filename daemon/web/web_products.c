#include "web_products.h"

#include "base/json.h"
#include "base/program.h"
#include "web_files.h"

#include <glib/gstdio.h>
#include <libsoup/soup.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#define NICE        10   /* of the child process */
#define MAX_WHY     1000 /* bytes of an error message */
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

/* A file that is being made. */
struct making {
    WebProducts *products; /* NULL after web_products_free() */
    struct product *product;
    GSubprocess *process;
    guint limit_id;
};

struct WebProducts {
    char *folder;    /* NULL until the first file is made */
    GPtrArray *list; /* of struct product, the oldest first */
    struct making *making;
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
    if (products->making) {
        products->making->products = NULL;
        g_subprocess_force_exit(products->making->process);
        g_subprocess_wait(products->making->process, NULL, NULL);
        g_unlink(products->making->product->path);
    }
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

/* Returns the message of mesorig without its progress; g_free(). */
static char *message_of(GBytes *bytes) {
    gsize length = 0;
    const char *data = bytes ? g_bytes_get_data(bytes, &length) : NULL;
    g_autofree char *all = g_strndup(data ? data : "", length);
    const char *last = g_strrstr(all, "mesorig: ");
    g_autofree char *text = g_strndup(last ? last + strlen("mesorig: ") : all, MAX_WHY);
    g_strstrip(text);
    return *text ? g_utf8_make_valid(text, -1)
                 : g_strdup("mesorig has ended without a message: it took too long, or the "
                            "computer has too little memory");
}

static void on_made(GObject *process, GAsyncResult *result, gpointer data) {
    struct making *making = data;
    WebProducts *products = making->products;
    g_autoptr(GBytes) said = NULL;
    const gboolean ended =
        g_subprocess_communicate_finish(G_SUBPROCESS(process), result, NULL, &said, NULL);
    g_clear_handle_id(&making->limit_id, g_source_remove);
    if (!products) {
        product_free(making->product);
    } else if (ended && g_subprocess_get_successful(making->process)) {
        g_ptr_array_add(products->list, making->product);
        if (products->list->len > WEB_PRODUCTS_MAX)
            g_ptr_array_remove_index(products->list, 0);
    } else {
        products->failed = making->product;
        products->why = message_of(said);
    }
    if (products)
        products->making = NULL;
    g_object_unref(making->process);
    g_free(making);
}

static gboolean on_limit(gpointer data) {
    struct making *making = data;
    making->limit_id = 0;
    g_subprocess_force_exit(making->process);
    return G_SOURCE_REMOVE;
}

static void be_nice(gpointer data) {
    setpriority(PRIO_PROCESS, 0, NICE);
}

/* Starts the child process. Returns FALSE with an error if it cannot be started. */
static gboolean start(WebProducts *products, const char *session, const char *directory,
                      const struct kind *kind, GError **error) {
    g_autofree char *program = program_find("mesorig", error);
    if (!program ||
        (!products->folder && !(products->folder = g_dir_make_tmp("mesorig-web-XXXXXX", error))))
        return FALSE;
    g_autofree char *name = g_strdup_printf("%u-%s", ++products->n_made, kind->file);
    g_autofree char *path = g_build_filename(products->folder, name, NULL);
    const char *argv[N_ARGUMENTS + 5] = {program};
    int n = 1;
    for (int i = 0; i < N_ARGUMENTS && kind->arguments[i]; i++)
        argv[n++] = kind->arguments[i];
    argv[n++] = directory;
    argv[n++] = "-o";
    argv[n++] = path;
    g_autoptr(GSubprocessLauncher) launcher = g_subprocess_launcher_new(
        G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_PIPE);
    g_subprocess_launcher_set_child_setup(launcher, be_nice, NULL, NULL);
    GSubprocess *process = g_subprocess_launcher_spawnv(launcher, argv, error);
    if (!process)
        return FALSE;
    product_free(products->failed);
    products->failed = NULL;
    g_clear_pointer(&products->why, g_free);
    struct product *product = g_new(struct product, 1);
    *product = (struct product){g_strdup(session), kind, g_steal_pointer(&path), g_get_real_time()};
    struct making *making = products->making = g_new0(struct making, 1);
    *making = (struct making){products, product, process,
                              g_timeout_add_seconds(WEB_PRODUCTS_LIMIT_S, on_limit, making)};
    g_subprocess_communicate_async(process, NULL, NULL, on_made, making);
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
    g_autofree char *directory = web_files_directory(task);
    if (!directory)
        return;
    if (task->products->making)
        web_task_refuse(task, SOUP_STATUS_CONFLICT,
                        "another file is being made: try again when it is ready");
    else if (!start(task->products, task->name, directory, kind, &error))
        web_task_refuse(task, SOUP_STATUS_CONFLICT, error->message);
    else
        web_task_answer(task, SOUP_STATUS_OK, "{}\n");
}

static void add_text(GVariantBuilder *to, const char *key, const char *value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(value));
}

/* Returns a maybe of an object; why may be NULL. product NULL gives nothing. */
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
    g_variant_builder_add(&to, "{sv}", "making",
                          describe(products->making ? products->making->product : NULL, NULL));
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
