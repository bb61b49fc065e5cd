# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabulary of materials: the library material nearest to each word that people use for one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class MaterialWord:
    """A word that names a material, an object made of it, or its finish.

    Parameters
    ----------
    material : str
        The nearest one of :data:`.procedural.MATERIALS`.
    scale, depth : float
        Size of its features, and height besides, relative to that material.
    colour : str
        A key of :data:`.colour_words.COLOURS`.
    weight : int
        3 names the material itself, 2 an object or a trade name, 1 a finish that other materials
        may have as well.
    """

    material: str
    scale: float
    depth: float
    colour: str
    weight: int

    @property
    def kind(self) -> str:
        """Kind of the material: gravel, metal, fabric or wood."""
        return self.material.partition("-")[0]


_TABLE: Final = (
    # Gravel and stone
    ("gravel-coarse", 0.75, 1.0, "grey", 3,
     "gravel, gravelly, stone, stony, rock, rocky, aggregate, scree, talus, roadstone, hoggin, "
     "moraine, mineral, cinder"),
    ("gravel-coarse", 0.75, 1.0, "grey", 2,
     "driveway, quarry, courtyard, cliff, grotto, rockery, cave, riverbank, railway, railroad, "
     "gravel path, gravel road, footpath, trail"),
    ("gravel-pebbles", 1.0, 1.0, "beige", 3,
     "pebble, pebbly, shingle, river rock, river stone, beach stone, pea gravel, pebblestone"),
    ("gravel-pebbles", 1.0, 1.0, "beige", 2,
     "riverbed, stream bed, creek bed, aquarium, seashore, shoreline, brook, zen garden, "
     "rolling stones, shore"),
    ("gravel-pebbles", 6.0, 0.6, "grey", 3,
     "cobble, cobblestone, cobbled, sett, paver, boulder, paving stone, flagstone, fieldstone, "
     "crazy paving"),
    ("gravel-sharp", 1.0, 1.0, "grey", 3,
     "crushed stone, crushed rock, crushed granite, crushed limestone, rubble, flint, slag, "
     "clinker, scoria, lava, basalt, granite, macadam, ballast, stone chipping, chipping, "
     "shale, pumice, obsidian, coal, ore, road metal, stone chip, crushed shell, crushed "
     "glass, crushed brick, quartz, gneiss, volcanic rock"),
    ("gravel-sharp", 1.0, 1.0, "grey", 2,
     "debris, shard, railway bed, track bed, debris field"),
    ("gravel-sharp", 1.0, 1.0, "grey", 1,
     "crushed, jagged, crunchy"),
    ("gravel-sharp", 0.7, 0.5, "charcoal", 3,
     "asphalt, tarmac, bitumen, blacktop, roughcast, pebbledash, tar"),
    ("gravel-sharp", 0.7, 0.5, "charcoal", 2,
     "road, street, pavement, motorway, highway, runway, parking lot, car park, kerb, sidewalk"),
    ("gravel-fine", 1.0, 1.0, "grey", 3,
     "grit, gritty, granule, granular, granulate, decomposed granite, chicken grit, road salt, "
     "rock salt, gravel dust, cat litter, perlite, vermiculite"),
    ("gravel-fine", 0.35, 0.8, "sand", 3,
     "sand, sandy, soil, earth, dirt, silt, clay, loam, mud, regolith, salt, sugar, dust"),
    ("gravel-fine", 0.35, 0.8, "sand", 2,
     "dune, desert, beach, ground, sandbox, sandpit, field"),
    ("gravel-fine", 0.5, 0.4, "grey", 3,
     "concrete, cement, mortar, stucco, plaster, render, brick, terracotta, masonry, breeze "
     "block, cinder block, adobe, ceramic, tile, exposed aggregate, terrazzo, tuff, rendering, "
     "brickwork, stonework, drywall, grout, gypsum, chalk"),
    ("gravel-fine", 0.5, 0.4, "grey", 1,
     "wall, facade"),
    ("gravel-fine", 0.4, 0.15, "white", 3,
     "marble, limestone, sandstone, slate, travertine, soapstone, alabaster, schist, onyx"),
    ("gravel-sharp", 0.08, 0.8, "tan", 3,
     "sandpaper, emery, abrasive, grindstone, whetstone, grip tape, emery cloth, emery paper, "
     "sanding belt, glasspaper, millstone"),
    # Metal
    ("metal-brushed", 1.0, 1.0, "silver", 3,
     "metal, metallic, steel, stainless, inox, aluminium, aluminum, titanium, nickel, zinc, "
     "alloy, tin, sheet metal, brushed metal, duralumin, magnesium, tungsten, steely, "
     "metalwork, brushed steel, brushed aluminium, brushed aluminum, brushed nickel, "
     "molybdenum, cobalt, amalgam"),
    ("metal-brushed", 1.0, 1.0, "brass", 3,
     "brass, brazen"),
    ("metal-brushed", 1.0, 1.0, "silver", 2,
     "fridge, refrigerator, elevator, lift door, appliance, sink, can, laptop, locker, filing "
     "cabinet, fuselage, aircraft, airplane, hull, propeller, toolbox, girder, machined, bolt, "
     "screw, nail, key, doorknob, faucet, tap, pipe, engine, turbine, machine, razor, "
     "scissors, spanner, wrench, padlock, tank, drum, bumper, kitchen hood"),
    ("metal-brushed", 1.0, 1.0, "silver", 1,
     "brushed, hairline, lathe, turned, milled, scratched, industrial, machinery, welded, "
     "riveted, forged, tempered"),
    ("metal-satin", 1.0, 1.0, "silver", 3,
     "chrome, chromed, chromium, platinum, satin metal, satin steel, satin nickel, satin "
     "chrome, foil, tinfoil, palladium, quicksilver, gunmetal, satin aluminium, satin brass, "
     "mirror steel, surgical steel, liquid metal, tinplate"),
    ("metal-satin", 1.0, 1.0, "silver", 2,
     "cutlery, silverware, blade, knife, sword, dagger, bodywork, bonnet, fork, spoon, coin, "
     "medal, jewellery, jewelry, ring, watch case, scalpel, car door, hubcap, trophy, trumpet, "
     "saxophone, dashboard, robot"),
    ("metal-satin", 1.0, 1.0, "silver", 2,
     "silver, sterling"),
    ("metal-satin", 1.0, 1.0, "gold", 2,
     "gold, gilded, gilt, bullion"),
    ("metal-satin", 1.0, 1.0, "silver", 1,
     "anodised, anodized, electroplated, mirror finish, plated, galvanic, ferrous"),
    ("metal-cast", 1.0, 1.0, "iron", 3,
     "cast iron, cast metal, cast steel, cast aluminium, iron, wrought iron, pig iron, lead, "
     "pewter, sandblasted steel, sandblasted metal, cast bronze, galvanised, galvanized, "
     "corten, ironwork, cast aluminum, scrap metal, ironclad, mild steel"),
    ("metal-cast", 1.0, 1.0, "iron", 2,
     "skillet, frying pan, anvil, foundry, manhole, radiator, ingot, dutch oven, cannon, "
     "anchor, horseshoe, railing, grate, dumbbell, barbell, cauldron, chain, rail, gate, wok, "
     "griddle, hatch, shipyard, boiler, blacksmith, stove, oven, statue"),
    ("metal-cast", 1.0, 2.5, "rust", 3,
     "rusted metal, rusty metal, rusted iron, rusty iron, rusted steel, rusty steel, scrap "
     "iron, corroded metal"),
    ("metal-cast", 1.0, 2.0, "rust", 1,
     "rust, rusty, rusted, corroded, corrosion, oxidised, oxidized, tarnished, pitted, shot "
     "peened, bead blasted, sandblasted, shot blasted"),
    ("metal-cast", 0.5, 3.0, "steel", 3,
     "steel wool, wire wool, wire mesh, chainmail, chain mail, mesh wire, chicken wire, metal "
     "mesh, steel mesh, wire cloth, wire gauze, barbed wire, wire, filings, iron filing, "
     "swarf, file, rasp, metal grid, cheese grater"),
    ("metal-hammered", 1.0, 1.0, "copper", 3,
     "copper, hammered copper, copperware"),
    ("metal-hammered", 1.0, 1.0, "bronze", 3,
     "bronze, hammered bronze"),
    ("metal-hammered", 1.0, 1.0, "silver", 3,
     "hammered metal, hammered steel, hammered silver, beaten metal, beaten copper, beaten "
     "gold, hammered tin, hammered brass, repousse, dented metal, hammered iron"),
    ("metal-hammered", 1.0, 1.0, "silver", 2,
     "gong, cymbal, armour, armor, breastplate, kettle, bell, shield, helmet, cooking pot, "
     "cookware, singing bowl, samovar, goblet, timpani, breast plate, saucepan"),
    ("metal-hammered", 1.0, 1.0, "silver", 1,
     "hammered, beaten, dented, planished, dimpled, dinged, peened, hammer marks, hammer tone"),
    ("metal-hammered", 3.0, 1.5, "steel", 3,
     "diamond plate, tread plate, checker plate, chequer plate, treadplate, corrugated iron, "
     "corrugated steel, corrugated metal, durbar plate, metal grating, steel grating, floor "
     "plate, tin roof"),
    # Fabric
    ("fabric-shirting", 1.0, 1.0, "white", 3,
     "cotton, linen, cloth, fabric, textile, poplin, percale, muslin, voile, cambric, lawn, "
     "batiste, calico, gingham, madras, broadcloth, seersucker, gauze, gauzy, chiffon, "
     "organza, tulle, lace, cheesecloth, chambray, flax, material cloth, ramie, batik"),
    ("fabric-shirting", 1.0, 1.0, "white", 2,
     "shirt, bedsheet, bed sheet, pillowcase, pillow, handkerchief, napkin, tablecloth, table "
     "cloth, curtain, blouse, apron, bandage, drape, dress, skirt, clothing, clothes, garment, "
     "bedding, linens, quilt, duvet, dishcloth, t shirt, pyjamas, pajamas, robe, lampshade, "
     "banner, flag, mattress, tea towel, dishtowel, table runner, laundry, cushion cover, "
     "wardrobe, bed linen, tapestry, embroidery, embroidered, hem, patchwork, undershirt"),
    ("fabric-shirting", 1.0, 1.0, "white", 1,
     "woven, weave, stitched, threaded, sewn, tailored, pleated, thread, warp, weft, fibre, "
     "fiber, fibrous, loom, threadbare, cloth like, soft, needlework"),
    ("fabric-basket", 0.7, 0.8, "cream", 3,
     "canvas, sailcloth, oxford, tarpaulin, duck cloth, cotton duck, tarp, cordura, webbing, "
     "ripstop"),
    ("fabric-basket", 0.7, 0.8, "cream", 2,
     "tent, backpack, sail, sneaker, awning, rucksack, tote bag, deck chair, hammock, painting "
     "canvas, strap, belt, parachute, seat belt"),
    ("fabric-denim", 1.0, 1.0, "denim", 3,
     "denim, jean, dungaree, jeans"),
    ("fabric-denim", 1.0, 1.0, "denim", 2,
     "overalls, workwear, jeans jacket"),
    ("fabric-twill", 1.0, 1.0, "tan", 3,
     "twill, chino, gabardine, tweed, serge, herringbone, worsted, houndstooth, cavalry twill, "
     "whipcord, khaki drill, tartan, plaid, harris tweed, drill cloth"),
    ("fabric-twill", 1.0, 1.0, "wool", 3,
     "wool, woollen, woolen, woolly, flannel, cashmere, mohair, alpaca, merino, loden, angora, "
     "lambswool, camel hair, melton"),
    ("fabric-twill", 1.0, 1.0, "tan", 2,
     "suit, trousers, pants, coat, uniform, kilt, blazer, jacket, waistcoat, cardigan, "
     "overcoat, poncho, cape, lapel, sock"),
    ("fabric-basket", 1.0, 1.0, "jute", 3,
     "burlap, hessian, jute, sackcloth, sacking, gunny, hopsack, basket weave, monk's cloth, "
     "basketweave, homespun, sisal, hemp, rope, raffia, coir, homespun cloth, twine, seagrass"),
    ("fabric-basket", 1.0, 1.0, "jute", 2,
     "sack, doormat, mat, basket, potato bag, coffee bag, placemat, woven basket"),
    ("fabric-basket", 1.5, 1.2, "wool", 3,
     "knit, knitted, knitwear, crochet, crocheted, yarn, boucle, terry, terrycloth, terry "
     "cloth, chenille, aran, cable knit, macrame, jersey knit, waffle knit, jersey, tricot, "
     "chunky knit"),
    ("fabric-basket", 1.5, 1.2, "wool", 2,
     "sweater, jumper, scarf, beanie, mitten, towel, blanket, rug, carpet, kilim, carpeting, "
     "bathrobe, bath towel, shawl, afghan, sofa, couch, upholstery, armchair, pullover, throw, "
     "bath mat, carpet tile, cushion, glove, legging, washcloth, hoodie"),
    ("fabric-basket", 1.0, 1.0, "wool", 1,
     "upholstered, cosy, cozy, nubby, tufted, woven rug, slubby, quilted"),
    ("fabric-satin", 1.0, 1.0, "cream", 3,
     "silk, silky, silken, sateen, taffeta, nylon, polyester, rayon, viscose, satin fabric, "
     "satin cloth, satin weave, crepe, brocade, damask, lycra, spandex, microfiber, "
     "microfibre, satin ribbon, acetate, charmeuse, lame, modal, georgette, jacquard, "
     "polyamide"),
    ("fabric-satin", 1.0, 1.0, "cream", 2,
     "satin, ribbon, lingerie, kimono, necktie, sari, lining, ballgown, gown, negligee, "
     "bedspread, cravat, bow tie, umbrella, windbreaker, tights, stocking"),
    ("fabric-satin", 1.5, 1.5, "brown", 2,
     "leather, leathery, suede, nubuck, leatherette, hide, vinyl, chamois, sheepskin, "
     "buckskin, faux leather"),
    ("fabric-corduroy", 1.0, 1.0, "brown", 3,
     "corduroy, cord fabric, corded, needlecord, jumbo cord, pinwale, ribbed fabric, ribbed "
     "cloth, ottoman fabric, bedford cord, ribbed knit"),
    ("fabric-corduroy", 1.0, 1.0, "brown", 1,
     "cord, wale, ribbed"),
    ("fabric-corduroy", 0.35, 0.5, "red", 3,
     "velvet, velvety, velour, velveteen, plush, fleece, felt, moleskin, baize, fur, faux fur, "
     "crushed velvet, felted, polar fleece, fuzzy, fluffy, furry, panne"),
    ("fabric-corduroy", 0.35, 0.5, "green", 2,
     "pool table, billiard table, teddy bear, card table, plushie"),
    # Wood
    ("wood-oak", 1.0, 1.0, "wood", 3,
     "wood, wooden, timber, hardwood, woody, woodgrain, wood grain, rosewood"),
    ("wood-oak", 1.0, 1.0, "oak", 3,
     "oak, oaken, ash wood, ashwood, elm, acacia, hickory, locust wood, ash tree"),
    ("wood-oak", 1.0, 1.0, "walnut", 3,
     "walnut, wenge, iroko, merbau, ironwood tree, black walnut, zebrano"),
    ("wood-oak", 1.0, 1.0, "mahogany", 3,
     "mahogany, teak, chestnut wood, sapele, padauk, redwood, jarrah"),
    ("wood-oak", 1.0, 1.0, "oak", 2,
     "parquet, floorboard, hardwood floor, desk, barrel, cask, beam, banister, wainscot, "
     "bookshelf, pew, wine barrel, church door, bench, stair tread, joist, rafter, dining "
     "table, whisky cask, log table, ship deck, treasure chest, handrail, dresser, axe handle, "
     "chair, cabin floor"),
    ("wood-oak", 1.0, 1.0, "wood", 1,
     "table, door, floor, chest, furniture, carved, tree, forest, stool, grainy, barn, "
     "joinery, carpentry, whittled, splintery, splintered, knotty, lumberjack, sawn, hewn, "
     "cabinet, shelf, splinter, grain, year rings, growth ring, annual ring, knot"),
    ("wood-pine", 1.0, 1.0, "pine", 3,
     "pine, spruce, fir, larch, cedar, softwood, lumber, plank, planking, plywood board, "
     "douglas fir, hemlock wood, poplar, yew, cypress, juniper, pinewood, sequoia, two by "
     "four, clapboard, chipboard, osb, particle board, sawdust, wood chip, woodchip, bark "
     "chip, mulch"),
    ("wood-pine", 1.0, 1.0, "pine", 2,
     "board, crate, pallet, sauna, fence, fencing, scaffold, shed, picnic table, log cabin, "
     "bookcase, ladder, panelling, paneling, matchstick, broomstick, toothpick, cutting board "
     "planks"),
    ("wood-weathered", 1.0, 1.0, "driftwood", 3,
     "driftwood, bark, tree bark, weathered wood, barn wood, barnwood, reclaimed wood, old "
     "wood, rotten wood, weathered planks, weathered oak, weathered timber, tree stump, log, "
     "tree trunk, weathered pine, railway sleeper, railroad tie, weathered board, firewood, "
     "cork oak, rotting log, shipwreck timber, split rail, branch, twig, root"),
    ("wood-weathered", 1.0, 1.0, "driftwood", 2,
     "decking, pier, jetty, dock, boardwalk, stump, trunk, barn door, shipwreck, fence post, "
     "wharf, stave, palisade, barn wall, ranch, totem, shack, rowboat, barnboard"),
    ("wood-veneer", 1.0, 1.0, "birch", 3,
     "veneer, plywood, birch, maple, mdf, laminate, beech, balsa, bamboo, hornbeam, alder, "
     "basswood, sycamore, boxwood, wood laminate, beechwood, veneered, limewood, linden, "
     "aspen, wicker, rattan, fibreboard, hardboard, birchwood"),
    ("wood-veneer", 1.0, 1.0, "cherry", 3,
     "cherry wood, cherrywood, pear wood, cedarwood, cherry tree, ebony, sandalwood, olive "
     "wood"),
    ("wood-veneer", 1.0, 1.0, "birch", 2,
     "guitar, violin, cutting board, chopping board, ruler, skateboard, tabletop, countertop "
     "board, piano, cello, drumstick, pencil, chopstick, rolling pin, wooden spoon, "
     "breadboard, dashboard trim, humidor, baseball bat, cue, cabinetry, ukulele, drawer, clog"),
    ("wood-veneer", 0.6, 2.0, "cork", 3,
     "cork, corkboard, cork board"),
    # Things and places that are named for their material
    ("gravel-sharp", 1.0, 1.0, "grey", 2,
     "mountain, rock face, cliff face, cave wall, meteorite, asteroid, moon rock, geode, "
     "crystal, stalactite, ruin, lunar, crater, glacier moraine, landslide, construction site, "
     "demolition, canyon, ravine, dry stone wall, cairn"),
    ("gravel-coarse", 0.75, 1.0, "grey", 2,
     "roadside, path, forest track, stream, flowerbed, graveyard, playground, parking, verge, "
     "lane, embankment, seabed, lakeside, coast, patio, terrace, farm track, drainage, walkway"),
    ("gravel-fine", 1.0, 1.0, "grey", 3,
     "kitty litter, pea shingle, screed, gritstone, seashell, shell, popcorn, bean, lentil, "
     "rice, corn, seed, coffee bean, peppercorn, granola, crumb, breadcrumb, pellet, bead, "
     "marble chip, gravel bed"),
    ("gravel-fine", 0.5, 0.4, "grey", 2,
     "castle, temple, pyramid, cathedral, monument, fountain, bunker, dungeon, chimney, "
     "fireplace, pottery, flowerpot, kiln, hearth, tomb"),
    ("metal-brushed", 1.0, 1.0, "silver", 2,
     "bicycle, submarine, spaceship, spacecraft, satellite, vault, safe, zipper, hammer, axe "
     "head, rocket, tractor, truck, train, motorbike, motorcycle, garage door, shutter, ladle, "
     "tongs, thermos, flask, bucket, watering can, wrecking ball, escalator, wheel rim, "
     "piston, gear, cog, gun, rifle, pistol, bullet, drill bit, solder, hinge, handcuff, "
     "staple, needle, pin"),
    ("metal-cast", 0.5, 3.0, "steel", 2,
     "grille, grill, barbecue, cage, fencing wire, sieve, colander, drain cover, mesh, spring, "
     "netting wire, strainer, whisk, escalator step"),
    ("metal-cast", 1.0, 1.0, "iron", 2,
     "engine block, manhole cover, lamp post, cogwheel, fire hydrant, plough, plow, hydrant, "
     "bollard, stove plate, sewing machine, weight plate, kettlebell"),
    ("fabric-shirting", 1.0, 1.0, "white", 2,
     "hospital gown, nightgown, nightie, petticoat, wedding dress, veil, bandana, turban, "
     "uniform shirt, chef jacket, collar, cuff, sleeve, hankie, wrap, shroud, toga, costume, "
     "doily, bunting, bib, sling, diaper, nappy, pouch, polo shirt, underwear, underpants, "
     "boxers, tunic, smock, canopy"),
    ("fabric-basket", 1.5, 1.2, "wool", 2,
     "hoody, sweatshirt, bobble hat, woolly hat, mitt, car seat, train seat, cinema seat, "
     "tracksuit, doormat weave, pillow cover, sleeping bag, dishrag, flannel cloth, poncho "
     "wool, settee, ottoman, footstool, beanbag, headband, leg warmer, dressing gown, nest"),
    ("fabric-satin", 1.0, 1.0, "cream", 2,
     "swimsuit, leotard, tutu, bow, pyjama set, bra, pantyhose, tracksuit top, raincoat, "
     "anorak, flag silk, sash, parasol, kite"),
    ("fabric-satin", 1.5, 1.5, "brown", 2,
     "saddle, wallet, handbag, purse, boot, shoe, football, baseball glove, steering wheel, "
     "glove leather, briefcase, bag leather"),
    ("fabric-corduroy", 0.35, 0.5, "red", 2,
     "theatre curtain, theater curtain, teddy, stuffed animal, cat, dog, cuddly toy, slipper, "
     "felt hat, tennis ball, beret, jewellery box, puppet"),
    ("wood-oak", 1.0, 1.0, "oak", 2,
     "workbench, church pew, staircase, bannister, cupboard, bed frame, mantelpiece, rocking "
     "chair, cradle, coffin, casket, mallet, oar, paddle, canoe, walking stick, bowling alley, "
     "dance floor, pub table, butcher block, butcher, sideboard, treehouse, floor board, door "
     "frame, window frame, bat, ballroom floor, picture frame, bookend, gavel"),
    ("wood-pine", 1.0, 1.0, "pine", 3,
     "cedar shingle, wooden shingle, shake roof, timber frame, plasterboard lath, sawmill, "
     "matchwood, kindling, log wall, chalet, wooden box, sauna bench, ski hut, boarding, "
     "weatherboard"),
    ("wood-weathered", 1.0, 1.0, "driftwood", 2,
     "woodpile, old barn, ghost town, old boat, fishing boat, windmill, water wheel, hayloft, "
     "stable, haystack, straw, thatch, gatepost, signpost, railway tie, old cask, beaver dam"),
)  # fmt: skip


def _words() -> dict[str, MaterialWord]:
    found: dict[str, MaterialWord] = {}
    for material, scale, depth, colour, weight, words in _TABLE:
        entry = MaterialWord(material, scale, depth, colour, weight)
        for word in words.split(","):
            found.setdefault(word.strip(), entry)
    return found


WORDS: Final = _words()
"""Each word or phrase, in lower case, singular, without hyphens."""

LONGEST_PHRASE: Final = max(len(phrase.split()) for phrase in WORDS)
