"""Presets of materials: numbers of :class:`warpdeform.material.Material`, and where they come from."""

from typing import Any

_CLOTH_DATA = "Wang, O'Brien, Ramamoorthi, Data-Driven Elastic Models for Cloth, SIGGRAPH 2011"

PRESETS: dict[str, dict[str, Any]] = {
    "rubber": {
        "density": 950.0,
        "youngs_modulus": 1.5e6,
        "poisson_ratio": 0.49,
        "thickness": 0.0005,
        "source": "Vulcanised natural rubber, a sheet of half a millimetre: density 950 kg/m3 and shear modulus "
        "0.5 MPa from the MatWeb data sheet of vulcanised natural rubber, E = 3 G as of a nearly "
        "incompressible solid.",
    },
    "cotton": {
        "areal_density": 0.15,
        "membrane_stiffness": 1400.0,
        "poisson_ratio": 0.03,
        "shear_stiffness": 40.0,
        "bending_stiffness": 5e-6,
        "source": "Plain-weave shirting, representative: stretch, cross and shear stiffness of a woven cotton "
        f"blend of 0.22 kg/m2 ({_CLOTH_DATA}: Royal Target) scaled to 0.15 kg/m2; bending stiffness w "
        "c^3 (Peirce, The Handle of Cloth as a Measurable Quantity, 1930) with weight w and the "
        "bending length c = 15 mm of light plain weaves.",
    },
    "silk": {
        "areal_density": 0.07,
        "membrane_stiffness": 700.0,
        "poisson_ratio": 0.03,
        "shear_stiffness": 20.0,
        "bending_stiffness": 1.9e-6,
        "source": "Charmeuse of 16 momme (4.34 g/m2 each), representative: stretch and shear per mass as of "
        "cotton, which agrees with the small shear stiffness of silk weaves (Matsudaira, "
        "Characteristics of Mechanical Properties and Handles of Silk Filament Weaves, Kanazawa "
        "University); bending stiffness w c^3 (Peirce 1930) with c = 14 mm.",
    },
    "denim": {
        "areal_density": 0.324,
        "membrane_stiffness": (1050.0, 224.0),
        "poisson_ratio": 0.18,
        "shear_stiffness": 110.0,
        "bending_stiffness": 1.7e-5,
        "source": "Stretch denim of 11 oz, the stiff yarns along u: mass, stretch and cross stiffness measured "
        f"({_CLOTH_DATA}: 11oz Black Denim); shear 1.96 gf/(cm degree) and bending 0.174 gf cm2/cm are "
        "the KES-F means of six denims (Journal of Textiles 2016, 4614168, table 5).",
    },
    "paper": {
        "density": 800.0,
        "youngs_modulus": (7.44e9, 3.47e9),
        "poisson_ratio": 0.43,
        "shear_modulus": 2.04e9,
        "thickness": 0.0001,
        "source": "Office paper of 80 g/m2 and 0.1 mm, machine direction along u: E1, E2, G12 of a machine-made "
        "paper of 780 kg/m3 (Mann, Baum, Habeger, Tappi 63(2), 1980); sqrt(nu12 nu21) = 0.293 "
        "(Schulgasser, On the In-Plane Elastic Constants of Paper, Fibre Science and Technology, "
        "1981).",
    },
    "spring-steel": {
        "density": 7850.0,
        "youngs_modulus": 2.0e11,
        "poisson_ratio": 0.29,
        "thickness": 0.0001,
        "source": "Hardened carbon steel, a shim of 0.1 mm: E from the table of spring materials in Machinery's "
        "Handbook (28.5 to 29.5 million psi), density and Poisson's ratio of AISI 1095.",
    },
}
"""Materials by name; the `source` of each says where its numbers come from."""
