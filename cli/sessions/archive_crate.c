/* Writes an archive as the metadata of a research object: RO-Crate 1.1 (Soiland-Reyes et al. 2022),
 * a file of JSON-LD. The folder of the session is its data set. */
#include "archive.h"
#include "base/plural.h"

#include "base/json.h"
#include "base/output_file.h"

#include <string.h>

static void add_text(GVariantBuilder *to, const char *key, const char *value) {
    if (!value || !*value)
        return;
    g_autofree char *valid = g_utf8_make_valid(value, -1);
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(valid));
}

/* Begins an entity of the graph, which is an "a{sv}". A reference to another entity is {"@id":
 * …}. */
static GVariantBuilder *entity(const char *id, const char *type) {
    GVariantBuilder *ret = g_variant_builder_new(G_VARIANT_TYPE_VARDICT);
    add_text(ret, "@id", id);
    g_variant_builder_add(ret, "{sv}", "@type", g_variant_new_string(type));
    return ret;
}

static GVariant *reference(const char *id) {
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    add_text(&builder, "@id", id);
    return g_variant_builder_end(&builder);
}

static void add_reference(GVariantBuilder *to, const char *key, const char *id) {
    g_variant_builder_add(to, "{sv}", key, reference(id));
}

/* Finishes an entity and takes ownership of it. */
static void finish(GVariantBuilder *graph, GVariantBuilder *entity) {
    g_variant_builder_add_value(graph, g_variant_builder_end(entity));
    g_variant_builder_unref(entity);
}

static void add_folder(GVariantBuilder *graph, GVariantBuilder *parts, const char *id,
                       const char *name, const char *description) {
    GVariantBuilder *folder = entity(id, "Dataset");
    add_text(folder, "name", name);
    add_text(folder, "description", description);
    finish(graph, folder);
    g_variant_builder_add_value(parts, reference(id));
}

static void add_file(GVariantBuilder *graph, GVariantBuilder *parts, const char *path,
                     const char *format, gint64 bytes, const char *sha256, const char *made_by) {
    g_autofree char *id = g_uri_escape_string(path, "/", FALSE);
    GVariantBuilder *file = entity(id, "File");
    g_autofree char *size = bytes >= 0 ? g_strdup_printf("%" G_GINT64_FORMAT, bytes) : NULL;
    add_text(file, "name", path);
    add_text(file, "encodingFormat", format);
    add_text(file, "contentSize", size);
    add_text(file, "sha256", sha256);
    add_text(file, "description", made_by);
    finish(graph, file);
    g_variant_builder_add_value(parts, reference(id));
}

static void add_parts(GVariantBuilder *graph, GVariantBuilder *parts,
                      const struct archive *archive) {
    g_autofree char *frames =
        g_strdup_printf("%d frames, linear radiance (DN/ms), OpenEXR; session.db has the pose, "
                        "camera and SHA-256 of each",
                        archive->frames);
    g_autofree char *views = g_strdup_printf(
        "BTF: texel × view × light, %d × %d texels, one OpenEXR file for each of %d views; "
        "reflectance relative to a white diffuser lit from its normal, times cos θ of the light; "
        "camera RGB",
        archive->grid.width, archive->grid.height, archive->views);
    add_file(graph, parts, "session.db", "application/vnd.sqlite3", -1, NULL,
             "Plan, shots, frames, events, products and the files that described rig, session and "
             "calibration; every table describes itself");
    add_folder(graph, parts, "frames/", "frames", frames);
    if (archive->lasers > 0)
        add_folder(graph, parts, "laser/", "laser sweeps",
                   "Of each pixel the sweep's peak, OpenEXR; session.db has the SHA-256 of each");
    gboolean btf = FALSE;
    for (guint i = 0; i < archive->products->len; i++) {
        const struct session_product *product = archive->products->pdata[i];
        if (g_str_has_prefix(product->path, "products/btf/"))
            btf = TRUE;
        else
            add_file(graph, parts, product->path,
                     g_str_has_suffix(product->path, ".exr") ? "image/x-exr"
                                                             : "application/octet-stream",
                     product->bytes, product->sha256, product->made_by);
    }
    if (btf)
        add_folder(graph, parts, "products/btf/", "BTF", views);
}

static void add_root(GVariantBuilder *graph, const struct archive *archive, GVariant *parts) {
    GVariantBuilder *root = entity("./", "Dataset");
    g_autofree char *description = g_strdup_printf(
        "%s%sBTF and MDF of a flat sample of %g × %g mm (%d × %d texels), %d %s, %d %s, %d "
        "laser %s.%s%s",
        archive->sample, *archive->sample ? ". " : "", archive->grid.width_mm,
        archive->grid.height_mm, archive->grid.width, archive->grid.height,
        PLURAL(archive->views, "view"), PLURAL(archive->lights, "light"),
        PLURAL(archive->lasers, "position"), *archive->notes ? " " : "", archive->notes);
    add_text(root, "name", archive->name);
    add_text(root, "description", description);
    add_text(root, "datePublished", archive->created);
    add_text(root, "dateCreated", archive->created);
    if (*archive->license)
        add_reference(root, "license", archive->license);
    if (*archive->operator_name)
        add_reference(root, "author", "#operator");
    g_variant_builder_add(root, "{sv}", "hasPart", parts);
    add_reference(root, "mentions", "#capture");
    finish(graph, root);
}

char *archive_crate(const struct archive *archive) {
    GVariantBuilder graph, parts, crate, terms, context;
    g_variant_builder_init(&graph, G_VARIANT_TYPE("aa{sv}"));
    g_variant_builder_init(&parts, G_VARIANT_TYPE("aa{sv}"));
    GVariantBuilder *descriptor = entity("ro-crate-metadata.json", "CreativeWork");
    add_reference(descriptor, "conformsTo", "https://w3id.org/ro/crate/1.1");
    add_reference(descriptor, "about", "./");
    add_text(descriptor, "description", OUTPUT_FILE_TEXT("crate"));
    finish(&graph, descriptor);
    add_parts(&graph, &parts, archive);
    add_root(&graph, archive, g_variant_builder_end(&parts));

    GVariantBuilder *capture = entity("#capture", "CreateAction");
    add_text(capture, "name", archive->imported ? "Import" : "Capture");
    add_text(capture, "description", archive->imported);
    add_text(capture, "startTime", archive->created);
    add_reference(capture, "instrument", "#program");
    add_reference(capture, "result", "./");
    if (*archive->operator_name) {
        GVariantBuilder *person = entity("#operator", "Person");
        add_text(person, "name", archive->operator_name);
        finish(&graph, person);
        add_reference(capture, "agent", "#operator");
    }
    finish(&graph, capture);
    GVariantBuilder *program = entity("#program", "SoftwareApplication");
    const char *version = strchr(archive->program, ' ');
    add_text(program, "name", "Mesorig");
    add_text(program, "version", version ? version + 1 : archive->program);
    finish(&graph, program);
    if (*archive->license) {
        GVariantBuilder *license = entity(archive->license, "CreativeWork");
        add_text(license, "name", archive->license);
        finish(&graph, license);
    }

    /* The context of RO-Crate 1.1 lacks the term sha256 of schema.org, so the file defines it. */
    g_variant_builder_init(&terms, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&terms, "{sv}", "sha256",
                          g_variant_new_string("https://schema.org/sha256"));
    g_variant_builder_init(&context, G_VARIANT_TYPE("av"));
    g_variant_builder_add(&context, "v",
                          g_variant_new_string("https://w3id.org/ro/crate/1.1/context"));
    g_variant_builder_add(&context, "v", g_variant_builder_end(&terms));
    g_variant_builder_init(&crate, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&crate, "{sv}", "@context", g_variant_builder_end(&context));
    g_variant_builder_add(&crate, "{sv}", "@graph", g_variant_builder_end(&graph));
    return json_text(g_variant_builder_end(&crate));
}
