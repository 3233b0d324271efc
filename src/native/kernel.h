/* Calls of kernels from Python. A kernel is declared once, and its parameters, its checks and its description are
 * derived from that:
 *
 *     FAST_KERNEL(rcdn_depths, (PICTURE, p), (SIZE, n, xy, 0), (IN, double, xy, n, 2), (REAL, least),
 *                 (OUT, double, out, n)) {
 *         for (index_t k = 0; k < n; k++) ...
 *         return 0;
 *     }
 *
 * Python passes a value for each of these except SIZE, LET and WHERE, in this order:
 *
 *     (PICTURE, name)                               uint8 or float32 (H, W) of at least one pixel: a Picture
 *     (IN, type, name, dimensions...)               array of this shape: const type *
 *     (OUT, type, name, dimensions...)              the same, writable: type *
 *     (WITHIN, type, name, low, high, dimensions...)  as IN, integers within low..high: for use as an index
 *     (ROOM, type, name, least)                     a workspace of at least so many items: type *
 *     (INT, name, low, high)                        an integer within low..high: index_t
 *     (REAL, name)                                  double
 *     (GROUP, type, name)                           a tuple, as described by the ARGUMENT_GROUP of the type: a struct
 *
 *     (SIZE, name, array, axis)                     the length of the axis of an array: index_t
 *     (LET, name, value)                            index_t
 *     (WHERE, condition)                            a condition on all preceding arguments
 *
 * Checks run in the order of the list: dimensions, limits and conditions are expressions of preceding arguments. If one
 * fails, TypeError or ValueError is raised, and the kernel is not called. Values are not converted. No writable array
 * shares memory with another one. A kernel returns a non-negative number, or NO_MEMORY, which raises MemoryError. */
#ifndef RCDN_KERNEL_H
#define RCDN_KERNEL_H

#include "rcdn.h"

#define NO_MEMORY ((index_t) - 1)
#define REFUSED ((index_t) - 2)

/* Integers that may be pixels lie within ± this; no axis of an array is longer, so that a product of a few of them
 * cannot overflow. */
enum { FURTHEST = 1 << 30 };

/* largest number of axes of an array, and of values of a call, including those in groups */
enum { MOST_AXES = 4, MOST_VALUES = 48 };

typedef struct Spec Spec;
typedef struct Value Value;
typedef struct Kernel Kernel;

/* Arguments that belong together. */
typedef struct {
    const char *name;
    const Spec *specs;
    int count;
} Group;

/* An argument: description of the value that Python must pass. */
struct Spec {
    const char *name;
    enum { PICTURE_GIVEN, ARRAY_GIVEN, INT_GIVEN, REAL_GIVEN, GROUP_GIVEN } what;
    char kind; /* of an array's items, as in NumPy, and their size, bytes */
    int itemsize, axes, written;
    const Group *group;
};

/* A value passed by Python. */
struct Value {
    const Spec *spec;
    void *data;
    const index_t *shape;
    index_t size; /* items */
    Picture picture;
    index_t whole;
    double real;
    const Value *group;
};

/* Reason why a call was refused: an argument and its requirement, in words and numbers. */
typedef struct {
    const Value *value;
    const char *wanted;
    enum { SHAPE_REFUSED, SIZE_REFUSED, RANGE_REFUSED, CONDITION_REFUSED } why;
    index_t numbers[MOST_AXES], given;
} Refusal;

struct Kernel {
    const char *name, *signature;
    const Spec *specs;
    int count;
    index_t (*checked)(const Value *given, Refusal *refusal);
    Kernel *next;
};

/* Named numbers shared by Python and C; they are defined in C. */
typedef struct Constants Constants;
struct Constants {
    const char *unit, *names; /* names: with commas between them */
    const index_t *values;
    int count;
    Constants *next;
};

void register_kernel(Kernel *kernel);
void register_constants(Constants *constants);

#define AT_LOADING __attribute__((constructor)) static void

/* ---- checks */

static inline index_t refused_shape(Refusal *refusal, const Value *value, const char *wanted, const index_t *shape) {
    *refusal = (Refusal){.value = value, .wanted = wanted, .why = SHAPE_REFUSED};
    memcpy(refusal->numbers, shape, (size_t)value->spec->axes * sizeof *shape);
    return REFUSED;
}

static inline int has_shape(const Value *value, const index_t *shape) {
    for (int k = 0; k < value->spec->axes; k++)
        if (value->shape[k] != shape[k])
            return 0;
    return 1;
}

static inline index_t refused_number(Refusal *refusal, const Value *value, const char *wanted, int why, index_t low,
                                     index_t high, index_t given) {
    *refusal = (Refusal){.value = value, .wanted = wanted, .why = why, .numbers = {low, high}, .given = given};
    return REFUSED;
}

/* The index of the first of `count` numbers outside low..high, or `count`. */
#define OUTLIER_OF(type)                                                                            \
    static inline index_t outlier_##type(const type *x, index_t count, index_t low, index_t high) { \
        for (index_t k = 0; k < count; k++)                                                         \
            if (x[k] < low || x[k] > high)                                                          \
                return k;                                                                           \
        return count;                                                                               \
    }
OUTLIER_OF(int64_t)
OUTLIER_OF(int32_t)

/* ---- the list of arguments: all macros with the same prefix define what one argument contributes */

#define EACH_1(M, a) M(a)
#define EACH_2(M, a, ...) M(a) EACH_1(M, __VA_ARGS__)
#define EACH_3(M, a, ...) M(a) EACH_2(M, __VA_ARGS__)
#define EACH_4(M, a, ...) M(a) EACH_3(M, __VA_ARGS__)
#define EACH_5(M, a, ...) M(a) EACH_4(M, __VA_ARGS__)
#define EACH_6(M, a, ...) M(a) EACH_5(M, __VA_ARGS__)
#define EACH_7(M, a, ...) M(a) EACH_6(M, __VA_ARGS__)
#define EACH_8(M, a, ...) M(a) EACH_7(M, __VA_ARGS__)
#define EACH_9(M, a, ...) M(a) EACH_8(M, __VA_ARGS__)
#define EACH_10(M, a, ...) M(a) EACH_9(M, __VA_ARGS__)
#define EACH_11(M, a, ...) M(a) EACH_10(M, __VA_ARGS__)
#define EACH_12(M, a, ...) M(a) EACH_11(M, __VA_ARGS__)
#define EACH_13(M, a, ...) M(a) EACH_12(M, __VA_ARGS__)
#define EACH_14(M, a, ...) M(a) EACH_13(M, __VA_ARGS__)
#define EACH_15(M, a, ...) M(a) EACH_14(M, __VA_ARGS__)
#define EACH_16(M, a, ...) M(a) EACH_15(M, __VA_ARGS__)
#define EACH_17(M, a, ...) M(a) EACH_16(M, __VA_ARGS__)
#define EACH_18(M, a, ...) M(a) EACH_17(M, __VA_ARGS__)
#define EACH_19(M, a, ...) M(a) EACH_18(M, __VA_ARGS__)
#define EACH_20(M, a, ...) M(a) EACH_19(M, __VA_ARGS__)
#define COUNT_OF(_1, _2, _3, _4, _5, _6, _7, _8, _9, _10, _11, _12, _13, _14, _15, _16, _17, _18, _19, _20, count, \
                 ...)                                                                                              \
    count
#define LENGTH(...) COUNT_OF(__VA_ARGS__, 20, 19, 18, 17, 16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0)
#define JOINED(a, b) JOINED_NOW(a, b)
#define JOINED_NOW(a, b) a##b
#define EACH(M, ...) JOINED(EACH_, LENGTH(__VA_ARGS__))(M, __VA_ARGS__)

#define KIND_double 'f', sizeof(double)
#define KIND_float 'f', sizeof(float)
#define KIND_int64_t 'i', sizeof(int64_t)
#define KIND_int32_t 'i', sizeof(int32_t)
#define KIND_int8_t 'i', sizeof(int8_t)
#define KIND_uint8_t 'u', sizeof(uint8_t)

/* its description */
#define SPEC(argument) SPEC_OF argument
#define SPEC_OF(tag, ...) SPEC_##tag(__VA_ARGS__)
#define SPEC_PICTURE(name) {#name, PICTURE_GIVEN, 0, 0, 2, 0, NULL},
#define SPEC_IN(type, name, ...) {#name, ARRAY_GIVEN, KIND_##type, LENGTH(__VA_ARGS__), 0, NULL},
#define SPEC_OUT(type, name, ...) {#name, ARRAY_GIVEN, KIND_##type, LENGTH(__VA_ARGS__), 1, NULL},
#define SPEC_WITHIN(type, name, low, high, ...) SPEC_IN(type, name, __VA_ARGS__)
#define SPEC_ROOM(type, name, least) SPEC_OUT(type, name, least)
#define SPEC_INT(name, low, high) {#name, INT_GIVEN, 0, 0, 0, 0, NULL},
#define SPEC_REAL(name) {#name, REAL_GIVEN, 0, 0, 0, 0, NULL},
#define SPEC_GROUP(type, name) {#name, GROUP_GIVEN, 0, 0, 0, 0, &type##_group},
#define SPEC_SIZE(name, array, axis)
#define SPEC_LET(name, value)
#define SPEC_WHERE(condition)

/* its index among the values that Python passes */
#define PLACE(argument) PLACE_OF argument
#define PLACE_OF(tag, ...) PLACE_##tag(__VA_ARGS__)
#define PLACE_PICTURE(name) at_##name,
#define PLACE_IN(type, name, ...) at_##name,
#define PLACE_OUT(type, name, ...) at_##name,
#define PLACE_WITHIN(type, name, low, high, ...) at_##name,
#define PLACE_ROOM(type, name, least) at_##name,
#define PLACE_INT(name, low, high) at_##name,
#define PLACE_REAL(name) at_##name,
#define PLACE_GROUP(type, name) at_##name,
#define PLACE_SIZE(name, array, axis)
#define PLACE_LET(name, value)
#define PLACE_WHERE(condition)

/* its declaration as a parameter of the kernel or a member of a group's struct */
#define NONE_()
#define COMMA_() ,
#define SEMICOLON_() ;
#define PARAMETER(argument) PARAMETER_OF argument
#define PARAMETER_OF(tag, ...) FIELD_##tag(COMMA_, NONE_, __VA_ARGS__)
#define MEMBER(argument) MEMBER_OF argument
#define MEMBER_OF(tag, ...) FIELD_##tag(NONE_, SEMICOLON_, __VA_ARGS__)
#define FIELD_PICTURE(before, after, name) before() Picture name after()
#define FIELD_IN(before, after, type, name, ...) before() const type *name after()
#define FIELD_OUT(before, after, type, name, ...) before() type *name after()
#define FIELD_WITHIN(before, after, type, name, low, high, ...) before() const type *name after()
#define FIELD_ROOM(before, after, type, name, least) before() type *name after()
#define FIELD_INT(before, after, name, low, high) before() index_t name after()
#define FIELD_REAL(before, after, name) before() double name after()
#define FIELD_GROUP(before, after, type, name) before() type name after()
#define FIELD_SIZE(before, after, name, array, axis) before() index_t name after()
#define FIELD_LET(before, after, name, value) before() index_t name after()
#define FIELD_WHERE(before, after, condition)

/* its name, where it is passed on or stored */
#define PASS(argument) PASS_OF argument
#define PASS_OF(tag, ...) NAME_##tag(COMMA_, NONE_, __VA_ARGS__)
#define FILL(argument) FILL_OF argument
#define FILL_OF(tag, ...) NAME_##tag(NONE_, COMMA_, __VA_ARGS__)
#define NAME_PICTURE(before, after, name) before() name after()
#define NAME_IN(before, after, type, name, ...) before() name after()
#define NAME_OUT(before, after, type, name, ...) before() name after()
#define NAME_WITHIN(before, after, type, name, low, high, ...) before() name after()
#define NAME_ROOM(before, after, type, name, least) before() name after()
#define NAME_INT(before, after, name, low, high) before() name after()
#define NAME_REAL(before, after, name) before() name after()
#define NAME_GROUP(before, after, type, name) before() name after()
#define NAME_SIZE(before, after, name, array, axis) before() name after()
#define NAME_LET(before, after, name, value) before() name after()
#define NAME_WHERE(before, after, condition)

/* its checks, and a variable of its name */
#define TAKE(argument) TAKE_OF argument
#define TAKE_OF(tag, ...) TAKE_##tag(__VA_ARGS__)
#define TAKE_PICTURE(name) const Picture name = given_[at_##name].picture;
#define TAKE_IN(type, name, ...)                       \
    const index_t name##_shape_[] = {__VA_ARGS__};     \
    const type *const name = given_[at_##name].data;   \
    if (!has_shape(given_ + at_##name, name##_shape_)) \
        return refused_shape(refusal, given_ + at_##name, #__VA_ARGS__, name##_shape_);
#define TAKE_OUT(type, name, ...)                      \
    const index_t name##_shape_[] = {__VA_ARGS__};     \
    type *const name = given_[at_##name].data;         \
    if (!has_shape(given_ + at_##name, name##_shape_)) \
        return refused_shape(refusal, given_ + at_##name, #__VA_ARGS__, name##_shape_);
#define TAKE_WITHIN(type, name, low, high, ...)                                                       \
    TAKE_IN(type, name, __VA_ARGS__)                                                                  \
    const index_t name##_outlier_ = outlier_##type(name, given_[at_##name].size, low, high);          \
    if (name##_outlier_ < given_[at_##name].size)                                                     \
        return refused_number(refusal, given_ + at_##name, #low ".." #high, RANGE_REFUSED, low, high, \
                              (index_t)name[name##_outlier_]);
#define TAKE_ROOM(type, name, least)           \
    type *const name = given_[at_##name].data; \
    if (given_[at_##name].size < (least))      \
        return refused_number(refusal, given_ + at_##name, #least, SIZE_REFUSED, least, 0, given_[at_##name].size);
#define TAKE_INT(name, low, high)                 \
    const index_t name = given_[at_##name].whole; \
    if (name < (low) || name > (high))            \
        return refused_number(refusal, given_ + at_##name, #low ".." #high, RANGE_REFUSED, low, high, name);
#define TAKE_REAL(name) const double name = given_[at_##name].real;
#define TAKE_GROUP(type, name)                                 \
    type name;                                                 \
    if (type##_taken(given_[at_##name].group, refusal, &name)) \
        return REFUSED;
#define TAKE_SIZE(name, array, axis) const index_t name = given_[at_##array].shape[axis];
#define TAKE_LET(name, value) const index_t name = (value);
#define TAKE_WHERE(condition) \
    if (!(condition))         \
        return refused_number(refusal, NULL, #condition, CONDITION_REFUSED, 0, 0, 0);

/* ---- declarations */

#define KERNEL(function, ...)       \
    DECLARED(function, __VA_ARGS__) \
    static index_t function(Refusal *refusal EACH(PARAMETER, __VA_ARGS__))

/* Compiled for every level. Functions that it calls must be INLINE, or they are compiled for the baseline only. */
#ifdef X86_LEVELS
#define FAST_KERNEL(function, ...)                                                 \
    INLINE index_t function##_body(Refusal *refusal EACH(PARAMETER, __VA_ARGS__)); \
    LEVEL_OF(FOR_AVX512, function, _avx512, __VA_ARGS__)                           \
    LEVEL_OF(FOR_AVX2, function, _avx2, __VA_ARGS__)                               \
    LEVEL_OF(, function, _baseline, __VA_ARGS__)                                   \
    DECLARED(function, __VA_ARGS__)                                                \
    static index_t function(Refusal *refusal EACH(PARAMETER, __VA_ARGS__)) {       \
        if (level_taken() >= AVX512_LEVEL)                                         \
            return function##_avx512(refusal EACH(PASS, __VA_ARGS__));             \
        if (level_taken() >= AVX2_LEVEL)                                           \
            return function##_avx2(refusal EACH(PASS, __VA_ARGS__));               \
        return function##_baseline(refusal EACH(PASS, __VA_ARGS__));               \
    }                                                                              \
    INLINE index_t function##_body(Refusal *refusal EACH(PARAMETER, __VA_ARGS__))
#define LEVEL_OF(attribute, function, level, ...)                                                          \
    attribute static                                                                                       \
        __attribute__((noinline)) index_t function##level(Refusal *refusal EACH(PARAMETER, __VA_ARGS__)) { \
        return function##_body(refusal EACH(PASS, __VA_ARGS__));                                           \
    }
#else
#define FAST_KERNEL(function, ...) KERNEL(function, __VA_ARGS__)
#endif

/* The part of a kernel that is visible to Python. */
#define DECLARED(function, ...)                                                             \
    static index_t function(Refusal *refusal EACH(PARAMETER, __VA_ARGS__));                 \
    static const Spec function##_specs[] = {EACH(SPEC, __VA_ARGS__)};                       \
    static index_t function##_checked(const Value *given_, Refusal *refusal) {              \
        enum { EACH(PLACE, __VA_ARGS__) };                                                  \
        EACH(TAKE, __VA_ARGS__)                                                             \
        return function(refusal EACH(PASS, __VA_ARGS__));                                   \
    }                                                                                       \
    AT_LOADING function##_registered(void) {                                                \
        static Kernel kernel = {#function,          #__VA_ARGS__,                           \
                                function##_specs,   sizeof function##_specs / sizeof(Spec), \
                                function##_checked, NULL};                                  \
        register_kernel(&kernel);                                                           \
    }

/* A struct whose members Python passes in a tuple. */
#define ARGUMENT_GROUP(type, ...)                                                                \
    typedef struct {                                                                             \
        EACH(MEMBER, __VA_ARGS__)                                                                \
    } type;                                                                                      \
    static const Spec type##_specs[] = {EACH(SPEC, __VA_ARGS__)};                                \
    static const Group type##_group = {#type, type##_specs, sizeof type##_specs / sizeof(Spec)}; \
    static inline index_t type##_taken(const Value *given_, Refusal *refusal, type *out_) {      \
        enum { EACH(PLACE, __VA_ARGS__) };                                                       \
        EACH(TAKE, __VA_ARGS__)                                                                  \
        *out_ = (type){EACH(FILL, __VA_ARGS__)};                                                 \
        return 0;                                                                                \
    }

/* Integer constants of a file, by name, for `rcdn.native.constants(unit)`. */
#define CONSTANTS(unit, ...)                                                                   \
    AT_LOADING unit##_constants_registered(void) {                                             \
        static const index_t values[] = {__VA_ARGS__};                                         \
        static Constants constants = {#unit, #__VA_ARGS__, values, LENGTH(__VA_ARGS__), NULL}; \
        register_constants(&constants);                                                        \
    }

#endif
