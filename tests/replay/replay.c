/* `replay CALLS`: make the calls of kernels that `record.py` wrote down, without Python, and compare each result and each array bit for bit. Says how
 * many differ, and returns whether any does. For processors and systems that run programs, but no Python. */
#include <inttypes.h>
#include <stdio.h>

#include "kernel.h"

static Kernel *kernels;

void register_kernel(Kernel *kernel) {
    kernel->next = kernels;
    kernels = kernel;
}

void register_constants(Constants *constants) {
    (void)constants;
}

static FILE *calls;

static void take(void *into, size_t size) {
    if (size && fread(into, size, 1, calls) != 1) {
        printf("the file of calls ends too early\n");
        exit(2);
    }
}

static int64_t whole(void) {
    int64_t number;
    take(&number, sizeof number);
    return number;
}

/* Memory for `size` bytes of an array, as NumPy aligns them. */
static void *room(index_t size) {
    char *memory = calloc((size_t)size + 128, 1);
    if (!memory)
        exit(2);
    return memory + 64 - (uintptr_t)memory % 64;
}

static Value *take_all(const Spec *specs, int count) {
    Value *values = calloc((size_t)count + 1, sizeof *values);
    for (int k = 0; k < count; k++) {
        const Spec *spec = specs + k;
        Value *v = values + k;
        v->spec = spec;
        if (spec->what == GROUP_GIVEN)
            v->group = take_all(spec->group->specs, spec->group->count);
        else if (spec->what == INT_GIVEN)
            v->whole = (index_t)whole();
        else if (spec->what == REAL_GIVEN)
            take(&v->real, sizeof v->real);
        else {
            index_t *shape = calloc(MOST_AXES, sizeof *shape);
            v->shape = shape;
            v->size = 1;
            for (int axis = 0; axis < spec->axes; axis++)
                v->size *= shape[axis] = (index_t)whole();
            const index_t itemsize = (index_t)whole();
            v->data = room(v->size * itemsize);
            take(v->data, (size_t)(v->size * itemsize));
            if (spec->what == PICTURE_GIVEN)
                v->picture = (Picture){v->data, shape[0], shape[1], itemsize == 4};
        }
    }
    return values;
}

/* How many of the arrays that were written to have other bytes than written down. */
static int differing(const Value *values, const Spec *specs, int count) {
    int differ = 0;
    for (int k = 0; k < count; k++) {
        if (specs[k].what == GROUP_GIVEN)
            differ += differing(values[k].group, specs[k].group->specs, specs[k].group->count);
        if (specs[k].what != ARRAY_GIVEN || !specs[k].written)
            continue;
        const size_t size = (size_t)(values[k].size * specs[k].itemsize);
        char *expected = room((index_t)size);
        take(expected, size);
        if (strcmp(specs[k].name, "work") && memcmp(expected, values[k].data, size)) { /* what a workspace holds is nobody's business */
            differ++;
            printf("  %s differs\n", specs[k].name);
        }
    }
    return differ;
}

static const Kernel *named(const char *name) {
    for (const Kernel *k = kernels; k; k = k->next)
        if (!strcmp(k->name, name))
            return k;
    printf("there is no kernel %s\n", name);
    exit(2);
}

int main(int count, char **arguments) {
    const char *level = find_level();
    if (count < 2 || !level || !(calls = fopen(arguments[1], "rb")))
        return 2;
    int made = 0, wrong = 0;
    for (char name[64]; fread(name, sizeof name, 1, calls) == 1; made++) {
        const Kernel *kernel = named(name);
        const Value *values = take_all(kernel->specs, kernel->count);
        Refusal refusal;
        const index_t result = kernel->checked(values, &refusal);
        const int64_t expected = whole();
        const int differ = differing(values, kernel->specs, kernel->count);
        if (differ || result != expected) {
            wrong++;
            printf("%s: %" PRId64 ", not %" PRId64 "; %d arrays differ\n", name, (int64_t)result, expected, differ);
        }
    }
    printf("%s: %d calls, %d differ\n", level, made, wrong);
    return wrong > 0 || made == 0;
}
