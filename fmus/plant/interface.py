ANKLE_MUSCLES = ("ext_dig", "per_brev", "per_long", "per_tert", "ext_hal", "flex_dig", "flex_hal", "tib_post")
EVERTORS = ANKLE_MUSCLES[:4]
