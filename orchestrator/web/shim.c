/* What a page calls of loops: each as `fmus/c/fmi2.c` has it between instantiation and its last step,
   with rows of outputs. `loops.h` is generated: `web_loops`, their blocks. */
#include "block.h"
#include "loops.h"

#include <stdlib.h>

#define WEB_EXPORT(name) __attribute__((export_name(#name))) name

enum { WEB_ROWS = 1024 };

/* what setjmp and longjmp throw in WebAssembly */
__asm__(".tagtype __c_longjmp i32\n"
        ".globl __c_longjmp\n"
        "__c_longjmp:\n");

static const block_description *web_block;
static char *web_self;
static double *web_rows;
static char web_said[1400];

static size_t web_whole(const block_description *of)
{
    size_t size = block_room(of->size);
    for (size_t k = 0; k < of->part_count; k++) size += block_room(of->parts[k]->size);
    return size;
}

/* raises BlockError where a parameter is outside its bounds or not finite */
static void web_check(void)
{
    for (size_t k = 0; k < web_block->count; k++) {
        const block_variable *v = &web_block->variables[k];
        if (v->causality != 'p' || v->kind != 'R') continue;
        const double x = *(const double *)(web_self + v->offset);
        if (isfinite(x) && !(x < v->low) && !(x > v->high)) continue;
        py_text_begin();
        py_text(v->name);
        py_text(" = ");
        py_text_float(x);
        py_text(isfinite(x) ? " is outside " : " is not a finite number");
        if (isfinite(x)) py_text(v->bounds);
        py_raise(PY_BLOCK_ERROR, py_text_end());
    }
}

static void web_row(double *row)
{
    for (size_t k = 0; k < web_block->count; k++) {
        const block_variable *v = &web_block->variables[k];
        const char *at = web_self + v->offset;
        if (v->causality != 'o') continue;
        *row++ = v->kind == 'R' ? *(const double *)at
               : v->kind == 'I' ? (double)*(const int64_t *)at : (double)*(const bool *)at;
    }
}

static void web_failed(void)
{
    strncpy(web_said, py_caught_text(), sizeof web_said - 1);
    *(bool *)(web_self + web_block->fault) = true;
}

/* what the last failure said */
const char *WEB_EXPORT(web_text)(void) { return web_said; }

/* where rows are: up to WEB_ROWS, each of all outputs, the first of them `fault` */
double *WEB_EXPORT(web_out)(void) { return web_rows; }

/* a loop as new, with the values of its declaration */
void WEB_EXPORT(web_open)(int loop)
{
    size_t outputs = 0;
    free(web_self);
    free(web_rows);
    web_block = web_loops[loop];
    for (size_t k = 0; k < web_block->count; k++)
        outputs += web_block->variables[k].causality == 'o';
    web_self = calloc(web_whole(web_block), 1);
    web_rows = calloc(WEB_ROWS * outputs, sizeof *web_rows);
    memcpy(web_self, web_block->at_start, web_block->size);
    *(const char **)web_self = "loop";
    memset(web_said, 0, sizeof web_said);
}

/* a parameter, by its place among all variables */
void WEB_EXPORT(web_set)(int k, double x)
{
    const block_variable *v = &web_block->variables[k];
    char *at = web_self + v->offset;
    if (v->kind == 'R') *(double *)at = x;
    else if (v->kind == 'I') *(int64_t *)at = (int64_t)x;
    else *(bool *)at = x != 0.0;
}

/* the row at the start; 0 where the loop cannot start, which `web_text` explains */
int WEB_EXPORT(web_start)(double t)
{
    py_frame frame;
    if (PY_TRY(frame)) {
        web_check();
        web_block->start(web_self);
        web_block->output(web_self, t);
        py_end_try();
        web_row(web_rows);
        return 1;
    }
    web_failed();
    return 0;
}

/* so many steps, a row after each; how many were made: fewer where one failed */
int WEB_EXPORT(web_fly)(int steps, double start, int done, double dt)
{
    size_t outputs = 0;
    volatile int made = 0;
    py_frame frame;
    for (size_t k = 0; k < web_block->count; k++)
        outputs += web_block->variables[k].causality == 'o';
    if (PY_TRY(frame)) {
        while (made < steps && made < WEB_ROWS) {
            const double t = start + (done + made) * dt;
            web_block->advance(web_self, t, dt);
            web_block->output(web_self, t + dt);
            web_row(web_rows + (size_t)made * outputs);
            made++;
        }
        py_end_try();
        return made;
    }
    web_failed();
    return made;
}
