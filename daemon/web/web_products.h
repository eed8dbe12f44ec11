/*
 * The tasks of files that are made of a session directory (web_task.h): its report, a page with the
 * material in 3D, and a glTF file. A child process makes them (web_child.h). The files are in a
 * temporary folder, which is removed when the server ends. A file is out of date when its session
 * was changed later. The name of a task is that of the session.
 */
#pragma once

#include "web_task.h"

#define WEB_PRODUCTS_MAX 16 /* files that are kept; the oldest one is removed */

WebProducts *web_products_new(void);
/* The child must have been freed before. NULL is ignored. */
void web_products_free(WebProducts *products);

/* Begins to make a file. The query names it: product=report, page or gltf. The answer is {}. */
void web_products_make(const struct web_task *task);

/* Answers {"making": {"session", "product"} or null, "failed": {"session", "product", "why"} or
 * null, "products": [{"session", "product", "file", "bytes"}, …]}. Files that are out of date are
 * left out. */
void web_products_list(const struct web_task *task);

/* Answer with the file. The headers of the answer allow the scripts of a page only to draw. */
void web_products_report(const struct web_task *task);
void web_products_page(const struct web_task *task);
void web_products_gltf(const struct web_task *task);
